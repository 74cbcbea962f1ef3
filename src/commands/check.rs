//! `check`: every mistake of a graph file, before anything runs.

use super::output::{say, say_json};
use super::session::{Failure, Session, print_diagnostics};
use super::{Common, GraphArgs};
use crate::registry::Registry;
use serde_json::json;

#[derive(clap::Args)]
pub struct Check {
    #[command(flatten)]
    graph: GraphArgs,
}

impl Check {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let graph = Session::graph(&self.graph, registry)?;
        let (nodes, outputs, vars) = (graph.nodes.len(), graph.outputs.len(), graph.vars.len());
        if common.json {
            return say_json(
                &json!({ "ok": true, "nodes": nodes, "outputs": outputs, "variables": vars }),
            );
        }
        print_diagnostics(&graph.warnings);
        say(format_args!("ok  {nodes} nodes, {outputs} outputs, {vars} variables\n"))
    }
}
