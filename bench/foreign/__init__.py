"""Path-traced light that no part of the project had a hand in, taken the whole way."""
