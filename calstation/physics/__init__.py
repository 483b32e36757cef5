"""Pure physics: error model, earth, strapdown, table geometry, motion as data, units."""
