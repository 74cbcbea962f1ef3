//! What a run did, node by node: ran, reused, how long, and what nodes reported.

use serde::Serialize;

/// One node's part of a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NodeSummary {
    /// Its name in the graph.
    pub name: String,
    /// Its type.
    pub kind: String,
    /// Executions in all.
    pub executions: usize,
    /// Those that ran now.
    pub ran: usize,
    /// Wall clock seconds of those, added up; executions that ran side by side count both.
    pub seconds: f64,
    /// What it reported: counted repairs and fallbacks, each once.
    pub notes: Vec<String>,
}

/// A whole run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Every node that was needed, in the order of the graph.
    pub nodes: Vec<NodeSummary>,
    /// Wall clock seconds.
    pub seconds: f64,
    /// Most memory the process held, bytes, mapped pages included; 0 where the system does not say.
    pub peak_bytes: u64,
}

impl Summary {
    /// Executions that ran, of all.
    pub fn ran(&self) -> (usize, usize) {
        (self.nodes.iter().map(|n| n.ran).sum(), self.nodes.iter().map(|n| n.executions).sum())
    }

    /// Names of the nodes of which anything ran, in the order of the graph.
    pub fn nodes_that_ran(&self) -> Vec<&str> {
        self.nodes.iter().filter(|n| n.ran > 0).map(|n| n.name.as_str()).collect()
    }
}

/// Most memory the process has held so far, in bytes.
pub fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().trim_end_matches(" kB").trim().parse::<u64>().ok())
        .map_or(0, |kib| kib * 1024)
}
