"""Scripts that measure batches of many sessions."""
