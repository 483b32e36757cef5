"""Pure physics: error model, earth, strapdown, table geometry, motion steps and units; no filter, file or device."""
