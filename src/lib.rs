//! Lightloom: graph files, keys, cache, scheduler and command line for pipelines of nodes.
//!
//! This package knows nothing of light: the nodes are in `lightloom-nodes`, and other crates may add
//! theirs with [`registry::Registry::with`].

pub mod commands;
pub mod engine;
pub mod graph;
pub mod registry;
pub mod report;
pub mod store;
pub mod sweep;

pub use engine::Bindings;
pub use lightloom_nodes as nodes;
