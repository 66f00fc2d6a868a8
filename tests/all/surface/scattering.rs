//! How surfaces scatter: energy, reciprocity, densities.
