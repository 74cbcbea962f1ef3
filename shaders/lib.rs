//! Compute shaders in WGSL and the Rust mirror of their structs.
//!
//! What is here: the column of the lighting tensor for one light ([`element`]), which takes the
//! answers of shadow rays as a bitset. Tests parse and validate every shader and compare the memory
//! layout of its structs with their mirrors; no test runs a shader, so the arithmetic is untested.
//!
//! What is not here yet: traversal of the hierarchy, reductions, and anything that runs a shader.
//! There is no launcher and no dependency on wgpu, whose feature `gpu` comes with the launcher. The
//! CPU renders everything.

pub mod element;
#[cfg(test)]
mod layout;
