//! The parts of a graph file: variables, nodes and outputs, each a list of names with values.

use super::diagnostic::{Code, Diagnostic, Source, Span, nearest, suggest};
use super::set::Setting;
use super::syntax::GRAPH_FIELDS;
use super::tree::{Field, Shape, Value};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The fields of `Graph`, each without what could not be read.
#[derive(Default)]
pub struct Sections {
    /// `vars`.
    pub vars: Vec<Field>,
    /// `nodes`.
    pub nodes: Vec<Field>,
    /// `outputs`.
    pub outputs: Vec<Field>,
}

impl Sections {
    /// Takes the tree of a file apart.
    pub fn of(source: &Arc<Source>, root: Value, mistakes: &mut Vec<Diagnostic>) -> Self {
        let mut sections = Sections::default();
        let whole = root.span.clone();
        let fields = match root.shape {
            Shape::Fields(name, fields) if name.as_ref().is_none_or(|n| n.text() == "Graph") => {
                fields
            }
            Shape::Broken => return sections,
            _ => {
                let start = Span { source: Arc::clone(source), range: first_word(&whole) };
                mistakes.push(
                    Diagnostic::new(Code::Field, start, "expected `Graph(`")
                        .help(super::GRAPH_FORM.to_owned()),
                );
                return sections;
            }
        };
        let head = Span { source: Arc::clone(source), range: first_word(&whole) };
        let mut seen = BTreeMap::new();
        for field in fields {
            if let Some(first) = seen.insert(field.name.clone(), field.key.clone()) {
                mistakes.push(twice("field", &field, &first));
                continue;
            }
            let list = match &*field.name {
                "vars" => &mut sections.vars,
                "nodes" => &mut sections.nodes,
                "outputs" => &mut sections.outputs,
                wrong => {
                    let message = format!("`Graph` has no field `{wrong}`");
                    let help = suggest(wrong, GRAPH_FIELDS, "it has");
                    mistakes.push(Diagnostic::new(Code::Field, field.key, message).help(help));
                    continue;
                }
            };
            match field.value.shape {
                Shape::Map(entries) => *list = unique(&field.name, entries, mistakes),
                Shape::Fields(None, none) if none.is_empty() => {}
                Shape::Broken => {}
                _ => {
                    let message = format!("expected `{}: {{ \"name\": ... }}`", field.name);
                    mistakes.push(Diagnostic::new(Code::Field, field.value.span, message));
                }
            }
        }
        let place = |name: &str| seen.get(name).unwrap_or(&head).clone();
        if sections.nodes.is_empty() {
            mistakes.push(Diagnostic::new(Code::Empty, place("nodes"), "there is no node"));
        } else if sections.outputs.is_empty() {
            let mut warning = Diagnostic::new(
                Code::Empty,
                place("outputs"),
                "there is no output: nothing is published",
            )
            .help("write `outputs: { \"name\": \"node\" }`".to_owned());
            warning.warning = true;
            mistakes.push(warning);
        }
        sections
    }
}

fn first_word(span: &Span) -> std::ops::Range<usize> {
    let text = span.text();
    let len = text
        .find(|c: char| !c.is_alphanumeric())
        .unwrap_or(text.len())
        .max(text.chars().next().map_or(0, char::len_utf8));
    span.range.start..span.range.start + len
}

/// Says what is wrong with names. A variable counts as it is given first; nodes and outputs are all kept,
/// to be checked too.
fn unique(section: &str, entries: Vec<Field>, mistakes: &mut Vec<Diagnostic>) -> Vec<Field> {
    let what = match section {
        "vars" => "variable",
        "nodes" => "node",
        _ => "output",
    };
    let mut seen: BTreeMap<String, Span> = BTreeMap::new();
    let mut kept = Vec::with_capacity(entries.len());
    for entry in entries {
        let legal = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
        if !entry.quoted {
            let message = format!(
                "the name of {} stands in quotes",
                if what == "output" { "an output" } else { "a variable or node" }
            );
            let help = format!("write \"{}\"", entry.name);
            mistakes.push(Diagnostic::new(Code::Name, entry.key.clone(), message).help(help));
        } else if entry.name.is_empty() || !entry.name.chars().all(legal) {
            let message = format!("{:?} cannot be the name of a {what}", entry.name)
                .replace("a output", "an output");
            let help = "names are made of letters, digits, `_` and `-`".to_owned();
            mistakes.push(Diagnostic::new(Code::Name, entry.key.clone(), message).help(help));
        }
        if let Some(first) = seen.get(&entry.name) {
            mistakes.push(twice(what, &entry, first));
            if what == "variable" {
                continue;
            }
        }
        seen.entry(entry.name.clone()).or_insert_with(|| entry.key.clone());
        kept.push(entry);
    }
    kept
}

/// The second of two entries of one name.
pub fn twice(what: &str, second: &Field, first: &Span) -> Diagnostic {
    let message = format!("the {what} `{}` is given twice", second.name);
    Diagnostic::new(Code::Duplicate, second.key.clone(), message)
        .label("again")
        .related(first.clone(), "first here")
}

/// A named piece of RON text that stands for itself wherever it is used.
struct Variable {
    name: String,
    key: Span,
    value: Value,
    used: Cell<bool>,
}

/// All variables of a graph, in the order of the file.
pub struct Variables(Vec<Variable>);

impl Variables {
    /// Those of the file, with the values that `settings` give.
    pub fn new(fields: Vec<Field>, settings: &[Setting], mistakes: &mut Vec<Diagnostic>) -> Self {
        let mut all: Vec<Variable> = fields
            .into_iter()
            .map(|f| Variable { name: f.name, key: f.key, value: f.value, used: Cell::new(false) })
            .collect();
        for setting in settings.iter().filter(|s| s.node.is_none()) {
            let name = setting.name.text();
            if let Some(variable) = all.iter_mut().find(|v| v.name == name) {
                variable.value = setting.value.clone();
                continue;
            }
            let help = suggest(name, all.iter().map(|v| &*v.name), "variables");
            let message = format!("there is no variable `{name}`");
            let help =
                help.or_else(|| Some("a field of a node is set as `node.field=value`".into()));
            mistakes.push(Diagnostic::new(Code::Set, setting.name.clone(), message).help(help));
        }
        for variable in &all {
            if matches!(&variable.value.shape, Shape::Text(text) if text.starts_with('$')) {
                let message = "a variable cannot stand for another variable";
                mistakes.push(Diagnostic::new(
                    Code::Variable,
                    variable.value.span.clone(),
                    message,
                ));
                variable.used.set(true);
            }
        }
        Variables(all)
    }

    /// What `value` stands for, and where its variable was named if it is one; none when that was a mistake.
    pub fn resolve<'a>(
        &'a self,
        value: &'a Value,
        mistakes: &mut Vec<Diagnostic>,
    ) -> Option<(&'a Value, Option<&'a Span>)> {
        let Shape::Text(text) = &value.shape else {
            return (!matches!(value.shape, Shape::Broken)).then_some((value, None));
        };
        let Some(name) = text.strip_prefix('$') else { return Some((value, None)) };
        let Some(variable) = self.0.iter().find(|v| v.name == name) else {
            let message = format!("there is no variable `{name}`");
            let names = self.0.iter().map(|v| &*v.name);
            let meant = nearest(name, names.clone());
            self.0.iter().filter(|v| Some(&*v.name) == meant).for_each(|v| v.used.set(true));
            let help = suggest(name, names, "variables");
            let help = help.or_else(|| Some(format!("add `vars: {{ \"{name}\": ... }}`")));
            mistakes.push(Diagnostic::new(Code::Variable, value.span.clone(), message).help(help));
            return None;
        };
        variable.used.set(true);
        let unusable = matches!(&variable.value.shape, Shape::Broken)
            || matches!(&variable.value.shape, Shape::Text(text) if text.starts_with('$'));
        (!unusable).then_some((&variable.value, Some(&value.span)))
    }

    /// Warns of variables that nothing used.
    pub fn unused(&self, mistakes: &mut Vec<Diagnostic>) {
        for variable in self.0.iter().filter(|v| !v.used.get()) {
            let message = format!("the variable `{}` is not used", variable.name);
            let mut warning = Diagnostic::new(Code::Unused, variable.key.clone(), message)
                .help(format!("use it as \"${}\", or remove it", variable.name));
            warning.warning = true;
            mistakes.push(warning);
        }
    }

    /// Name, text and place of each.
    pub fn given(&self) -> Vec<super::Given> {
        self.0
            .iter()
            .map(|v| super::Given {
                name: v.name.clone(),
                text: v.value.ron(),
                span: v.value.span.clone(),
            })
            .collect()
    }
}

/// `did you mean ...?` for a node that there is not.
pub fn nearest_node<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(wrong, names).map(|name| format!("did you mean \"{name}\"?"))
}
