"""The report: a replay's result folder as one HTML page that needs nothing else, no network and no other file.

Figures are written as SVG by :mod:`.chart`, :mod:`.map_chart` and :mod:`.timeline`; :mod:`.page` puts them together.
"""
