//! `nodes`: the catalogue of node types.

use super::Common;
use super::output::{say, say_json};
use super::session::Failure;
use crate::registry::{NodeType, Registry};
use lightloom_nodes::node::{Cardinality, ParamSpec, PortSpec};
use serde_json::{Value, json};
use std::fmt::Write as _;

#[derive(clap::Args)]
pub struct Nodes {
    /// The node type to describe; all are listed without it.
    kind: Option<String>,
    /// Prints the reference of all node types as Markdown.
    #[arg(long, conflicts_with = "kind")]
    markdown: bool,
}

impl Nodes {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        match &self.kind {
            Some(kind) => {
                let found = find(registry, kind)?;
                if common.json {
                    say_json(&json!({ "ok": true, "node": node_json(found) }))
                } else {
                    say(page(found))
                }
            }
            None if common.json => {
                let all: Vec<Value> = registry.types().iter().map(node_json).collect();
                say_json(&json!({ "ok": true, "nodes": all }))
            }
            None if self.markdown => say(reference(registry)),
            None => say(list(registry)),
        }
    }
}

fn find<'r>(registry: &'r Registry, kind: &str) -> Result<&'r NodeType, Failure> {
    registry.get(kind).ok_or_else(|| {
        let like = |t: &&NodeType| strsim::jaro(&t.kind.to_lowercase(), &kind.to_lowercase());
        let nearest = registry.types().iter().max_by(|a, b| like(a).total_cmp(&like(b)));
        let hint = nearest.map(|t| format!("; did you mean `{}`?", t.kind)).unwrap_or_default();
        Failure::Nothing(format!("there is no node type `{kind}`{hint}"))
    })
}

/// One line a type: name, what it gives, what it does.
fn list(registry: &Registry) -> String {
    let types = registry.types();
    let kinds = types.iter().map(|t| t.kind.len()).max().unwrap_or(0);
    let outputs = types.iter().map(|t| gives(t).len()).max().unwrap_or(0);
    let line = |t: &NodeType| {
        format!("{:kinds$}  {:outputs$}  {}\n", t.kind, gives(t), first_sentence(&t.doc))
    };
    types.iter().map(line).collect()
}

/// Everything about one type.
fn page(t: &NodeType) -> String {
    let mut out = format!("{} v{} -> {}\n", t.kind, t.version, gives(t));
    t.doc.lines().for_each(|line| {
        let _ = writeln!(out, "  {line}");
    });
    let table = |title: &str, rows: &[[String; 3]], out: &mut String| {
        let width = |k: usize| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0);
        let (first, second) = (width(0), width(1));
        if !rows.is_empty() {
            let _ = writeln!(out, "\n{title}");
        }
        for [name, what, doc] in rows {
            let _ = writeln!(out, "  {name:first$}  {what:second$}  {doc}");
        }
    };
    let ports: Vec<[String; 3]> =
        t.ports.iter().map(|p| [p.name.into(), port_type(p), p.doc.clone()]).collect();
    let params: Vec<[String; 3]> = t
        .params
        .iter()
        .map(|p| [p.name.into(), format!("{}, {}", value_type(p), default(p)), p.doc.clone()])
        .collect();
    table("inputs", &ports, &mut out);
    table("parameters", &params, &mut out);
    out
}

/// The whole reference as a Markdown page.
fn reference(registry: &Registry) -> String {
    let types = registry.types();
    let mut out = String::from(
        "# Nodes\n\nWritten by `lightloom nodes --markdown`. An input takes the name of a node, or a list of names \
         where it takes several nodes; a parameter without a default must be given.\n\n",
    );
    out += "| Node | Gives | |\n|---|---|---|\n";
    for t in types {
        let (kind, anchor) = (t.kind, t.kind.to_lowercase());
        let _ = writeln!(
            out,
            "| [{kind}](#{anchor}) | {} | {} |",
            gives(t),
            cell(first_sentence(&t.doc))
        );
    }
    for t in types {
        let _ = write!(
            out,
            "\n## {}\n\n{}\n\nVersion {}, gives {}.\n",
            t.kind,
            t.doc,
            t.version,
            gives(t)
        );
        if !t.ports.is_empty() {
            out += "\n| Input | Takes | |\n|---|---|---|\n";
        }
        for p in &t.ports {
            let _ = writeln!(out, "| `{}` | {} | {} |", p.name, port_type(p), cell(&p.doc));
        }
        if !t.params.is_empty() {
            out += "\n| Parameter | Type | Default | |\n|---|---|---|---|\n";
        }
        for p in &t.params {
            let shown = p.default.as_ref().map_or("must be given".into(), |d| format!("`{d}`"));
            let _ = writeln!(
                out,
                "| `{}` | {} | {} | {} |",
                p.name,
                cell(value_type(p)),
                cell(shown),
                cell(&p.doc)
            );
        }
    }
    out
}

fn node_json(t: &NodeType) -> Value {
    let port = |p: &PortSpec| {
        let (takes, required) = takes(p.cardinality);
        json!({ "name": p.name, "type": p.data, "takes": takes, "required": required, "doc": p.doc })
    };
    let param = |p: &ParamSpec| json!({ "name": p.name, "type": p.kind, "range": p.range, "default": p.default, "doc": p.doc });
    json!({
        "kind": t.kind, "version": t.version, "doc": t.doc, "output": t.output, "sequence": t.sequence,
        "inputs": t.ports.iter().map(port).collect::<Vec<_>>(),
        "parameters": t.params.iter().map(param).collect::<Vec<_>>(),
    })
}

fn gives(t: &NodeType) -> String {
    if t.sequence { format!("{} sequence", t.output) } else { t.output.into() }
}

/// How many artifacts a port takes, in a word, and whether it must be bound.
fn takes(cardinality: Cardinality) -> (&'static str, bool) {
    match cardinality {
        Cardinality::One => ("one", true),
        Cardinality::Optional => ("one", false),
        Cardinality::Many => ("several nodes", true),
        Cardinality::All => ("whole sequence", true),
        Cardinality::OptionalAll => ("whole sequence", false),
        Cardinality::Window => ("item and next", true),
    }
}

/// `Image`, `Lights, several nodes`, `Environment, optional`.
fn port_type(p: &PortSpec) -> String {
    let (takes, required) = takes(p.cardinality);
    let many = if takes == "one" { String::new() } else { format!(", {takes}") };
    let optional = if required { "" } else { ", optional" };
    format!("{}{many}{optional}", p.data)
}

/// `integer in 1..=65_536`.
fn value_type(p: &ParamSpec) -> String {
    p.range.map_or_else(|| p.kind.clone(), |range| format!("{} in {range}", p.kind))
}

fn default(p: &ParamSpec) -> String {
    p.default.as_ref().map_or("must be given".into(), |d| format!("default {d}"))
}

/// Up to the first full stop that a capital letter follows: `et al. 2008` does not end a sentence.
fn first_sentence(doc: &str) -> String {
    let text = doc.split_whitespace().collect::<Vec<_>>().join(" ");
    let ends = text.match_indices(". ").map(|(at, _)| at);
    let capital = |at: &usize| text[at + 2..].starts_with(char::is_uppercase);
    let end = ends.filter(|at| capital(at)).find(|&at| !text[..at].ends_with("et al"));
    end.map_or(text.clone(), |at| text[..=at].to_owned())
}

/// Text within a cell of a Markdown table.
fn cell(text: impl AsRef<str>) -> String {
    text.as_ref().split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Bench, told};
    use super::*;

    #[test]
    fn a_page_has_ports_and_parameters() {
        let bench = Bench::new();
        let text = page(find(bench.registry(), "Grey").ok().unwrap());
        assert_eq!(
            text,
            "Grey v1 -> Image\n  A square of one grey, brighter the later it is. For tests.\n\n\
             inputs\n  time  Time, optional  When; the start without it.\n\n\
             parameters\n  \
             level  number in 0.0..=1.0, default 0.5  Radiance at the start.\n  \
             size   integer, default 4                Pixels along each side.\n  \
             round  true | false, default false       What it does with the level.\n"
        );
    }

    #[test]
    fn a_kind_there_is_not_is_told_the_nearest() {
        let bench = Bench::new();
        let told =
            |kind: &str| find(bench.registry(), kind).err().map(|f| told(&f)).unwrap_or_default();
        assert_eq!(told("gray"), "there is no node type `gray`; did you mean `Grey`?");
        assert_eq!(told("PNGs"), "there is no node type `PNGs`; did you mean `Png`?");
    }

    #[test]
    fn every_node_is_listed_and_documented() {
        let registry = Registry::builtin();
        let (lines, markdown) = (list(&registry), reference(&registry));
        assert_eq!(lines.lines().count(), registry.types().len());
        for t in registry.types() {
            assert!(
                lines.lines().any(|l| l.split_whitespace().next() == Some(t.kind)),
                "{}",
                t.kind
            );
            assert!(markdown.contains(&format!("\n## {}\n", t.kind)), "{}", t.kind);
            assert!(
                t.params.iter().all(|p| markdown.contains(&format!("\n| `{}` |", p.name))),
                "{}",
                t.kind
            );
            let json = node_json(t);
            assert_eq!(json["inputs"].as_array().map(Vec::len), Some(t.ports.len()));
        }
        // Bars within cells would make columns.
        let bars = |line: &str| line.replace("\\|", "").matches('|').count();
        assert!(
            markdown.lines().filter(|l| l.starts_with("| `")).all(|l| (4..=5).contains(&bars(l)))
        );
    }

    #[test]
    fn sentences_end_before_capitals() {
        assert_eq!(
            first_sentence("As of Ha\u{161}an et al. 2008,\nsection 5. More."),
            "As of Ha\u{161}an et al. 2008, section 5."
        );
        assert_eq!(first_sentence("By Walter et al. In all. Then"), "By Walter et al. In all.");
        assert_eq!(first_sentence("One only"), "One only");
    }
}
