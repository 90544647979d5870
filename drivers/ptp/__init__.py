"""Still cameras over PTP: DSLR and mirrorless bodies on USB."""
