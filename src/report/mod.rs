//! Reports: one page without any network, and one table, that show what the points of a sweep or a
//! single run gave and cost.

mod csv;
mod document;
mod page;
mod pictures;

pub use csv::csv;
pub use document::*;
pub use page::{LIMIT, ReportError, page};
