//! One node of a graph file: its kind, parameters and the names on its ports.

use super::Given;
use super::diagnostic::{Code, Diagnostic, Span, suggest};
use super::file::{Variables, twice};
use super::set::Setting;
use super::tree::{Field, Shape, Value};
use crate::registry::{AnyNode, NodeType, Registry};
use lightloom_nodes::node::{Cardinality, ParamSpec, PortSpec, Problems};
use std::collections::BTreeMap;

/// A node as far as its own text tells.
pub struct Draft<'r> {
    /// Its name.
    pub name: String,
    /// Where the name stands.
    pub key: Span,
    /// Its type and the node itself; none when the kind is a mistake.
    pub made: Option<Made<'r>>,
}

/// A node of a known kind.
pub struct Made<'r> {
    /// Its type.
    pub kind: &'r NodeType,
    /// Where the kind stands.
    pub place: Span,
    /// The node, with the parameters that could be set.
    pub node: Box<dyn AnyNode>,
    /// The ports that are bound, in the order of the type.
    pub inputs: Vec<(&'r PortSpec, Vec<Link>)>,
    /// Whether nothing is wrong with the ports by themselves.
    pub sound: bool,
    /// The parameters as given.
    pub given: Vec<Given>,
}

/// The name of a node on a port.
pub struct Link {
    /// The node's name.
    pub name: String,
    /// Where it stands.
    pub span: Span,
}

/// A field of a node as the file or a `--set` gives it.
struct Entry<'a> {
    name: &'a str,
    key: &'a Span,
    value: &'a Value,
}

/// Reads one node, its fields replaced by those of `settings`.
pub fn draft<'r>(
    field: &Field,
    settings: &[&Setting],
    registry: &'r Registry,
    vars: &Variables,
    mistakes: &mut Vec<Diagnostic>,
) -> Draft<'r> {
    let mut draft = Draft { name: field.name.clone(), key: field.key.clone(), made: None };
    let none: &[Field] = &[];
    let (place, fields) = match &field.value.shape {
        Shape::Fields(Some(place), fields) => (place, &**fields),
        Shape::Word => (&field.value.span, none),
        Shape::Tuple(Some(place), items) => {
            let span = items.first().map_or(place, |item| &item.span).clone();
            let help = format!("write `{}(field: value)`", place.text());
            mistakes.push(
                Diagnostic::new(Code::Input, span, "the fields of a node have names").help(help),
            );
            (place, none)
        }
        Shape::Broken => return draft,
        _ => {
            let help = "write `Kind(field: value)`".to_owned();
            mistakes.push(
                Diagnostic::new(Code::Kind, field.value.span.clone(), "expected a node").help(help),
            );
            return draft;
        }
    };
    let entries = entries(fields, settings, vars, mistakes);
    let Some(kind) = registry.get(place.text()) else {
        let wrong = place.text();
        let help = suggest(wrong, registry.types().iter().map(|t| t.kind), "kinds");
        mistakes.push(
            Diagnostic::new(
                Code::Kind,
                place.clone(),
                format!("there is no kind of node `{wrong}`"),
            )
            .help(help),
        );
        // Variables count as used here: what was meant is not known.
        for entry in &entries {
            vars.resolve(entry.value, mistakes);
        }
        return draft;
    };
    let mut made = Made {
        kind,
        place: place.clone(),
        node: kind.make(),
        inputs: Vec::new(),
        sound: true,
        given: Vec::new(),
    };
    let before = mistakes.len();
    for entry in &entries {
        if let Some(param) = kind.params.iter().find(|p| p.name == entry.name) {
            made.set(param, entry, vars, mistakes);
        } else if let Some(port) = kind.ports.iter().find(|p| p.name == entry.name) {
            let before = mistakes.len();
            let links = links(port, entry, vars, mistakes);
            made.sound &= mistakes.len() == before;
            made.inputs.push((port, links));
        } else {
            let names = kind.params.iter().map(|p| p.name).chain(kind.ports.iter().map(|p| p.name));
            let help = suggest(entry.name, names, "it has");
            made.sound = false;
            let message = format!("`{}` has no parameter or port `{}`", kind.kind, entry.name);
            mistakes.push(Diagnostic::new(Code::Input, entry.key.clone(), message).help(help));
        }
    }
    let before_missing = mistakes.len();
    made.missing(&entries, mistakes);
    made.sound &= mistakes.len() == before_missing;
    if mistakes.len() == before {
        made.check(mistakes);
    }
    made.inputs.sort_by_key(|(port, _)| kind.ports.iter().position(|p| p.name == port.name));
    draft.made = Some(made);
    draft
}

fn entries<'a>(
    fields: &'a [Field],
    settings: &[&'a Setting],
    vars: &Variables,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<Entry<'a>> {
    let mut seen: BTreeMap<&str, &Span> = BTreeMap::new();
    let mut entries: Vec<Entry<'a>> = Vec::with_capacity(fields.len());
    for field in fields {
        if field.quoted {
            let help = format!("write `{}`", field.name);
            let message = "names of parameters and ports stand without quotes";
            mistakes.push(Diagnostic::new(Code::Name, field.key.clone(), message).help(help));
        }
        if let Some(first) = seen.get(&*field.name) {
            mistakes.push(twice("field", field, first));
            continue;
        }
        seen.insert(&field.name, &field.key);
        entries.push(Entry { name: &field.name, key: &field.key, value: &field.value });
    }
    for setting in settings {
        let entry = Entry { name: setting.name.text(), key: &setting.name, value: &setting.value };
        match entries.iter_mut().find(|e| e.name == entry.name) {
            Some(old) => {
                // The file is checked as if nothing replaced the value.
                vars.resolve(old.value, mistakes);
                *old = entry;
            }
            None => entries.push(entry),
        }
    }
    entries
}

impl Made<'_> {
    fn set(
        &mut self,
        param: &ParamSpec,
        entry: &Entry<'_>,
        vars: &Variables,
        mistakes: &mut Vec<Diagnostic>,
    ) {
        let Some((value, used)) = vars.resolve(entry.value, mistakes) else { return };
        let ron = value.ron();
        let broken = |m: &Diagnostic| m.code == Code::Syntax && m.span.within(&value.span);
        if let Err(what) = self.node.set(param.name, &ron)
            && !mistakes.iter().any(broken)
        {
            let mut mistake = Diagnostic::new(
                Code::Value,
                value.span.clone(),
                format!("`{}`: {what}", param.name),
            );
            if let Some(used) = used {
                mistake = mistake.related(used.clone(), format!("used here as `{}`", param.name));
            }
            mistakes.push(mistake.help(about(param.name, &param.doc)));
        }
        self.given.push(Given { name: param.name.into(), text: ron, span: value.span.clone() });
    }

    fn missing(&self, entries: &[Entry<'_>], mistakes: &mut Vec<Diagnostic>) {
        let given = |name: &str| entries.iter().any(|e| e.name == name);
        let params = self.kind.params.iter().filter(|p| p.default.is_none());
        let ports =
            self.kind.ports.iter().filter(|p| {
                !matches!(p.cardinality, Cardinality::Optional | Cardinality::OptionalAll)
            });
        let params = params.map(|p| (p.name, &p.doc, "a parameter", &*p.kind));
        for (name, doc, what, takes) in
            params.chain(ports.map(|p| (p.name, &p.doc, "a port", p.data)))
        {
            if !given(name) {
                let message =
                    format!("`{}` needs `{name}`, {what} of type {takes}", self.kind.kind);
                mistakes.push(
                    Diagnostic::new(Code::Missing, self.place.clone(), message)
                        .help(about(name, doc)),
                );
            }
        }
    }

    fn check(&self, mistakes: &mut Vec<Diagnostic>) {
        let mut problems = Problems::default();
        self.node.check(&mut problems);
        for (name, what) in problems.0 {
            let given = self.given.iter().find(|g| g.name == name);
            let span = given.map_or(&self.place, |g| &g.span).clone();
            mistakes.push(Diagnostic::new(Code::Check, span, format!("`{name}`: {what}")));
        }
    }
}

fn about(name: &str, doc: &str) -> Option<String> {
    (!doc.is_empty()).then(|| format!("`{name}`: {doc}"))
}

/// The names on a port.
fn links(
    port: &PortSpec,
    entry: &Entry<'_>,
    vars: &Variables,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<Link> {
    let Some((value, _)) = vars.resolve(entry.value, mistakes) else { return Vec::new() };
    let many = port.cardinality == Cardinality::Many;
    let optional = matches!(port.cardinality, Cardinality::Optional | Cardinality::OptionalAll);
    match &value.shape {
        Shape::List(items) if many => {
            if items.is_empty() {
                let message = format!("`{}` needs at least one node", port.name);
                mistakes.push(
                    Diagnostic::new(Code::Missing, value.span.clone(), message)
                        .help(about(port.name, &port.doc)),
                );
            }
            let mut links = Vec::with_capacity(items.len());
            for item in items {
                let Some((item, _)) = vars.resolve(item, mistakes) else { continue };
                links.extend(link(port, item, mistakes));
            }
            links
        }
        Shape::List(items) => {
            let mut mistake = Diagnostic::new(
                Code::Shape,
                value.span.clone(),
                format!("`{}` takes one node, not a list", port.name),
            );
            if let [one] = &**items {
                mistake = mistake.help(format!("write {}", one.span.text()));
            }
            mistakes.push(mistake);
            Vec::new()
        }
        Shape::Word if optional && value.span.text() == "None" => Vec::new(),
        _ => link(port, value, mistakes).into_iter().collect(),
    }
}

fn link(port: &PortSpec, value: &Value, mistakes: &mut Vec<Diagnostic>) -> Option<Link> {
    if let Shape::Text(name) = &value.shape {
        return Some(Link { name: name.clone(), span: value.span.clone() });
    }
    let message = format!("`{}` is a port and takes the name of a node", port.name);
    let mut mistake = Diagnostic::new(Code::Shape, value.span.clone(), message);
    mistake.help = match &value.shape {
        Shape::Word if value.span.text() != "None" => {
            Some(format!("write \"{}\"", value.span.text()))
        }
        Shape::Fields(Some(_), _) => {
            Some("give that node a name of its own under `nodes`, and name it here".into())
        }
        _ => about(port.name, &port.doc),
    };
    mistakes.push(mistake);
    None
}
