//! The engine: turns a graph into executions, knows which are needed, and runs those.

mod bindings;
mod execution;
mod identity;
mod manifest;
mod meter;
mod perform;
mod publish;
mod resolve;
mod schedule;
mod summary;
mod together;

pub use bindings::{Bindings, Held};
pub use execution::{Execution, Plan, Shot};
pub use identity::identities;
pub use manifest::Manifest;
pub use publish::{Numbers, Owner, Published, mean, numbers_of, publish, write_whole};
pub use resolve::{Resolution, Status};
pub use schedule::{Options, Progress, run};
pub use summary::{NodeSummary, Summary};

use crate::store::StoreError;
use lightloom_nodes::node;

/// Why a run ended without its results.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// A node failed.
    #[error("{name} ({kind}{item}) failed: {cause}")]
    Node {
        /// The node's name in the graph.
        name: String,
        /// Its type.
        kind: &'static str,
        /// Which of its items, for people; empty for a single one.
        item: String,
        /// What it said.
        cause: node::Error,
    },
    /// The run was asked to stop; what was finished is kept.
    #[error("stopped; what was finished is kept")]
    Cancelled,
    /// The cache failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file of the graph or of the output folder cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
}
