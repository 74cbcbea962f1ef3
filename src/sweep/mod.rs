//! Sweeps: a graph at many points of its parameters, measured against their cost.
//!
//! Points share whatever they have in common: their graphs are merged into one, so that every execution
//! that two points need runs once, and the whole is counted before it runs.
//!
//! ```ron
//! Sweep(
//!     graph: "../reference.ron",
//!     axes: [Grid({ "rows": [(5, 5), (10, 10)], "columns": [25, 50, 100] })],
//!     skip: ["columns > 4 * rows[0] * rows[1]"],
//!     seeds: { "seed": [1, 2, 3] },
//!     measure: ["tensor_error"],
//!     cost: ["tensor"],
//!     pictures: ["tensor_png"],
//!     plot: (x: evaluations, y: "tensor_error.relative_l2", colour: "rows"),
//!     limits: (jobs: 1, disk: 20),
//! )
//! ```

mod condition;
mod file;
mod front;
mod gather;
mod points;
mod reader;
mod results;
mod single;
mod work;

pub use file::{Choice, Limits, Sweep, Text, is_sweep};
pub use gather::cost_of;
pub use points::{Base, Point, edited, points};
pub use results::{Outline, document, node_of};
pub use single::{single, whole};
pub use work::{Group, Member, Work};
