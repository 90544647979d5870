"""Report pages: one HTML file each, that opens without a server and loads nothing.

`calibration_page` writes SESSION/calibration/report.html; `reconstruction_page` writes report.html into
a reconstruction's folder, with everything from the capture to the quality. A page is made of sections
(captured, calibrated, quality, comparisons, provenance): each module reads what its section shows, the
template of the same part lays it out.
"""
