"""Results of J. E. C. Kawecki, Initial Implementation and Testing of a Tightly-Coupled IMU/Pseudolite System, AFIT, 2015."""
