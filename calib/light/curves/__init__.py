"""Response curves of cameras that develop their pictures, from exposures that overlap."""
