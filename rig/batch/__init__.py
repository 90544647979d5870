"""Many sessions with many settings: a plan, and how it is carried out, in processes or on a cluster."""
