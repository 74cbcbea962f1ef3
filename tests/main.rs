//! All integration tests, one binary.

mod cli;
mod engine;
mod graphs;
mod workspace;
