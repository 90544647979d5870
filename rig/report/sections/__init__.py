"""The sections of the pages, each a record that its template shows."""
