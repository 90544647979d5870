"""How pages are served: to whom, what is shown first, and frames on their way to the browser."""
