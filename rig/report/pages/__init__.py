"""The pages: one module for each report.html."""
