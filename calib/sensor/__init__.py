"""Sensor measurements from darks and flats after EMVA 1288, or from the brackets of a scene."""
