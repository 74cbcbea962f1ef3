//! `graph`: draws a graph.

use super::output::{say, say_json};
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::graph::{Graph, dot, mermaid};
use crate::registry::Registry;
use serde_json::{Value, json};

/// Languages of drawings.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    /// For Graphviz.
    Dot,
    /// For Mermaid, which Markdown viewers draw.
    Mermaid,
}

#[derive(clap::Args)]
pub struct Draw {
    #[command(flatten)]
    graph: GraphArgs,
    /// Language of the drawing.
    #[arg(long, value_enum, default_value = "dot")]
    format: Format,
}

impl Draw {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let graph = Session::graph(&self.graph, registry)?;
        match (common.json, self.format) {
            (true, _) => say_json(&links(&graph)),
            (false, Format::Dot) => say(dot(&graph)),
            (false, Format::Mermaid) => say(mermaid(&graph)),
        }
    }
}

/// The nodes with what is bound to their ports, and the outputs.
fn links(graph: &Graph) -> Value {
    let name = |n: usize| &graph.nodes[n].name;
    let node = |n: &crate::graph::GraphNode| {
        let bound = |from: &[usize]| from.iter().map(|&f| name(f)).collect::<Vec<_>>();
        let inputs: serde_json::Map<String, Value> =
            n.inputs.iter().map(|(port, from)| ((*port).to_owned(), json!(bound(from)))).collect();
        json!({
            "name": n.name, "kind": n.kind, "output": n.output, "inputs": inputs,
            "runs": n.runs.word(), "items": n.axis.word(),
        })
    };
    let outputs: serde_json::Map<String, Value> =
        graph.outputs.iter().map(|(output, n)| (output.clone(), json!(name(*n)))).collect();
    json!({ "ok": true, "nodes": graph.nodes.iter().map(node).collect::<Vec<_>>(), "outputs": outputs })
}

#[cfg(test)]
mod tests {
    use super::super::tests::Bench;
    use super::*;

    #[test]
    fn links_name_ports_and_sequences() {
        let session = Bench::new().session(&[]);
        let value = links(&session.graph);
        let grey = value["nodes"].as_array().unwrap().iter().find(|n| n["name"] == "grey").unwrap();
        assert_eq!(grey["inputs"], json!({ "time": ["frames"] }));
        assert_eq!((&grey["runs"], &grey["output"]), (&json!("frames"), &json!("Image")));
        assert_eq!(value["outputs"]["picture"], "png");
        assert!(
            mermaid(&session.graph).contains("|time|")
                && dot(&session.graph).contains("label=\"time\"")
        );
    }
}
