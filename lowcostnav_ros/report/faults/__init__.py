"""The fault study on a terminal, on a page and in the documentation."""
