//! All integration tests, one binary.

mod analytic;
mod browser;
mod cli;
mod engine;
mod extremes;
mod graphs;
mod oddities;
mod pbgi;
mod reports;
mod runs;
mod scenes;
mod sweep;
mod tables;
mod tensor;
mod workspace;
