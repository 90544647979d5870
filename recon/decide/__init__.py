"""Which training runs: method, size, degree, corrections, budget. Each leaves its evidence as a rung."""
