//! Compute shaders.
