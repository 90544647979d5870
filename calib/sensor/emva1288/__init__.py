"""A sensor from repeated darks and flats, after EMVA 1288."""
