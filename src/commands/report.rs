//! `report`: a sweep or a run as one page for a browser, with its table as CSV and JSON.

use super::output::{say, say_json};
use super::session::{Failure, Session, read_text};
use super::sweep::{SweepSession, folder, stem, write_tables};
use super::{Common, GraphArgs};
use crate::engine::{EngineError, write_whole};
use crate::registry::Registry;
use crate::report::{Document, Fate, page};
use crate::sweep::{edited, is_sweep, single};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Report {
    /// A sweep file, or a graph file that was run.
    file: PathBuf,
    /// For a graph: replaces a variable or a parameter, as it was run.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Folder of the page; `out/` and the file's name by default.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Report {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let document = match is_sweep(&read_text(&self.file)?) {
            true if !self.set.is_empty() => {
                return Err(Failure::Usage(
                    "--set is for graphs: a sweep file says what it sets".into(),
                ));
            }
            true => {
                let session = SweepSession::open(common, &self.file, registry)?;
                let known = session.resolve()?;
                session.document(&known)
            }
            false => self.of_run(common, registry)?,
        };
        if document.points.iter().all(|p| p.fate == Fate::Missing) {
            let verb = if document.axes.is_empty() { "run" } else { "sweep" };
            let file = self.file.display();
            return Err(Failure::Nothing(format!(
                "nothing of it is in the cache: lightloom {verb} {file}"
            )));
        }
        let folder = folder(self.out.as_ref(), &self.file);
        let mut written = write_tables(&document, &folder)?;
        let path = folder.join("report.html");
        let io = |cause| EngineError::Io { path: path.clone(), cause };
        let text = page(&document).map_err(|e| io(std::io::Error::other(e.to_string())))?;
        write_whole(&path, text.as_bytes()).map_err(io)?;
        written.insert(0, path);
        if common.json {
            return say_json(
                &serde_json::json!({ "ok": true, "written": written, "bytes": text.len() }),
            );
        }
        let names: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        say(format!("wrote {}\n", names.join(", ")))
    }

    fn of_run(&self, common: &Common, registry: &Registry) -> Result<Document, Failure> {
        let args = GraphArgs { graph: self.file.clone(), set: self.set.clone() };
        let session = Session::open(common, &args, registry)?;
        let values = self.set.iter().filter_map(|set| set.split_once('='));
        let text = edited(&read_text(&self.file)?, values.map(|(n, v)| (n.trim(), v.trim())));
        let (title, source) = (stem(&self.file), self.file.display().to_string());
        Ok(single(session.graph, &session.store, text, &title, &source)?)
    }
}
