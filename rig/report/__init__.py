"""Report pages: one HTML file each, that opens without a server and loads nothing.

`pages` has one module for each page. A page is made of `sections`: each module reads what its section shows,
the template of the same name lays it out. `charts` draws.
"""
