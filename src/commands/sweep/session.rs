//! What the commands about sweeps share: reading a sweep with its graph, and its work.

use crate::commands::Common;
use crate::commands::session::{Failure, read_text, store_within};
use crate::engine::Resolution;
use crate::registry::Registry;
use crate::report::Document;
use crate::store::Store;
use crate::sweep::{Base, Outline, Sweep, Work, document, points};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A sweep that was read, merged and counted.
pub struct SweepSession {
    /// The file's content.
    pub sweep: Sweep,
    /// Its points, apart from their graphs.
    pub outline: Outline,
    /// Their graphs, merged.
    pub work: Work,
    /// The cache.
    pub store: Arc<Store>,
}

impl SweepSession {
    /// Reads a sweep file and opens the cache.
    pub fn open(common: &Common, path: &Path, registry: &Registry) -> Result<Self, Failure> {
        let text = read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let label = path.display().to_string();
        let sweep = Sweep::read(&text, &label, folder).map_err(Failure::Graph)?;
        let graph = read_text(&sweep.graph)?;
        let base = Base { text: &graph, path: &sweep.graph };
        let points = points(&sweep, &base, registry).map_err(Failure::Graph)?;
        let outline = Outline::new(&sweep, &base, &points, &stem(path), &label);
        let store = store_within(common, sweep.limits.disk)?;
        let work = Work::new(&sweep, points, &store).map_err(|e| Failure::Usage(e.to_string()))?;
        Ok(SweepSession { sweep, outline, work, store })
    }

    /// What the cache knows of each group, without running anything.
    pub fn resolve(&self) -> Result<Vec<Resolution>, Failure> {
        let settle = |group: &crate::sweep::Group| {
            let mut known = Resolution::new(&group.graph, &group.plan);
            known.settle(&group.graph, &group.plan, &self.store)?;
            Ok(known)
        };
        self.work.groups.iter().map(settle).collect()
    }

    /// All results, from what is known of each group.
    pub fn document(self, known: &[Resolution]) -> Document {
        document(self.outline, &self.work, known, &self.store)
    }
}

/// `rows_clusters` for `graphs/sweeps/rows_clusters.ron`.
pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// `out/rows_clusters` for it, unless the user names a folder.
pub fn folder(out: Option<&PathBuf>, path: &Path) -> PathBuf {
    out.cloned().unwrap_or_else(|| Path::new("out").join(stem(path)))
}
