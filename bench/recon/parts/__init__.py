"""Parts of a model, each with and without: what it gains on held-out evidence, and what it costs."""
