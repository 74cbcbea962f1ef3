//! Parameters: each is written once, with its default, range and meaning; the catalogue, the checks,
//! the canonical text of the key and the reading of a graph file all come from that one line.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Problems that a node finds in its own parameters, each with the parameter's name.
#[derive(Debug, Default)]
pub struct Problems(pub Vec<(&'static str, String)>);

impl Problems {
    /// Reports `what` about the parameter `name`.
    pub fn report(&mut self, name: &'static str, what: impl Into<String>) {
        self.0.push((name, what.into()));
    }
}

/// What the catalogue says of one parameter.
#[derive(Clone, Debug)]
pub struct ParamSpec {
    /// Name in graph files.
    pub name: &'static str,
    /// Type as a person would say it: `integer`, `number`, `max | random`.
    pub kind: String,
    /// The default as it would stand in a graph file; none when the parameter must be given.
    pub default: Option<String>,
    /// Allowed values, where the type alone does not say it.
    pub range: Option<&'static str>,
    /// Meaning, unit and source.
    pub doc: String,
}

/// The parameters of a node. Implemented by [`params!`](crate::params).
pub trait Params: Default + Clone + Send + Sync + 'static {
    /// What the node does, for the catalogue.
    fn doc() -> String;
    /// All parameters in the order of declaration.
    fn specs() -> Vec<ParamSpec>;
    /// Sets one parameter from its RON text.
    ///
    /// # Errors
    /// What was found and what was expected; also for a name that is not in [`Params::specs`].
    fn set(&mut self, name: &str, ron: &str) -> Result<(), String>;
    /// Every parameter in canonical text: equal text if and only if equal value. Files are left
    /// out: their content counts, not their path.
    fn canonical(&self) -> Vec<(&'static str, String)>;
    /// The paths of all `File` parameters.
    fn files(&self) -> Vec<PathBuf>;
    /// Makes every relative file path start at `folder` (the graph file's).
    fn resolve(&mut self, folder: &Path);
}

/// A type that a parameter may have.
pub trait ParamValue: Clone + Default + Send + Sync + 'static {
    /// The type's name for people.
    fn kind() -> String;
    /// Reads RON text; finite numbers only.
    ///
    /// # Errors
    /// What was expected.
    fn parse(ron: &str) -> Result<Self, String>;
    /// Text that [`ParamValue::parse`] reads back to the same bits.
    fn show(&self) -> String;
    /// The path, if this is a file.
    fn path(&mut self) -> Option<&mut PathBuf> {
        None
    }
}

/// A file parameter: keyed by content, never by its path's text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct File(pub PathBuf);

impl ParamValue for File {
    fn kind() -> String {
        "file".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let text: String = ron::from_str(ron).map_err(|_| expected("a path in quotes", ron))?;
        if text.is_empty() { Err("the path is empty".into()) } else { Ok(File(text.into())) }
    }
    fn show(&self) -> String {
        format!("{:?}", self.0.display().to_string())
    }
    fn path(&mut self) -> Option<&mut PathBuf> {
        Some(&mut self.0)
    }
}

/// A closed set of words. Implemented by [`choice!`](crate::choice).
pub trait Choice: Clone + Copy + Default + PartialEq + Send + Sync + 'static {
    /// Every value with its word.
    const WORDS: &'static [(&'static str, Self)];
}

impl<T: Choice> ParamValue for T {
    fn kind() -> String {
        T::WORDS.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(" | ")
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let word = ron.trim().trim_matches('"');
        let found = T::WORDS.iter().find(|(w, _)| *w == word);
        found
            .map(|(_, value)| *value)
            .ok_or_else(|| expected(&format!("one of {}", Self::kind()), ron))
    }
    fn show(&self) -> String {
        T::WORDS
            .iter()
            .find(|(_, value)| value == self)
            .map(|(word, _)| (*word).to_owned())
            .unwrap_or_default()
    }
}

fn expected(what: &str, found: &str) -> String {
    let found = found.trim();
    let shown: String = found.chars().take(40).collect();
    let dots = if shown.len() < found.len() { "..." } else { "" };
    format!("expected {what}, found `{shown}{dots}`")
}

/// Reads a finite number from RON text; `what` names the expectation in the error.
///
/// # Errors
/// When the text is no number, or is out of the range of a finite `f64`.
pub fn parse_number(ron: &str, what: &str) -> Result<f64, String> {
    let value: f64 = ron::from_str(ron).map_err(|_| expected(what, ron))?;
    if value.is_finite() { Ok(value) } else { Err(expected("a finite number", ron)) }
}

macro_rules! integers {
    ($($t:ty),*) => {$(
        impl ParamValue for $t {
            fn kind() -> String { "integer".into() }
            fn parse(ron: &str) -> Result<Self, String> {
                ron::from_str(ron).map_err(|_| {
                    expected(&format!("an integer from {} to {}", <$t>::MIN, <$t>::MAX), ron)
                })
            }
            fn show(&self) -> String { self.to_string() }
        }
    )*};
}
integers!(u32, u64);

impl ParamValue for f64 {
    fn kind() -> String {
        "number".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        // Adding zero turns -0.0 into 0.0, so that the two have one canonical text.
        parse_number(ron, "a number").map(|v| v + 0.0)
    }
    fn show(&self) -> String {
        format!("{self:?}")
    }
}

impl ParamValue for f32 {
    fn kind() -> String {
        "number".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let wide = parse_number(ron, "a number")?;
        let value = wide as f32 + 0.0;
        if !value.is_finite() {
            return Err(expected(&format!("a number of at most {:e} in size", f32::MAX), ron));
        }
        if value == 0.0 && wide != 0.0 {
            return Err(expected(
                &format!("0 or a number of at least {:e} in size", f32::MIN_POSITIVE),
                ron,
            ));
        }
        Ok(value)
    }
    fn show(&self) -> String {
        format!("{self:?}")
    }
}

impl ParamValue for bool {
    fn kind() -> String {
        "true | false".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        ron::from_str(ron).map_err(|_| expected("true or false", ron))
    }
    fn show(&self) -> String {
        self.to_string()
    }
}

impl<T: ParamValue + PartialEq, const N: usize> ParamValue for [T; N]
where
    [T; N]: Default,
{
    fn kind() -> String {
        format!("({})", vec![T::kind(); N].join(", "))
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let parts: Vec<&ron::value::RawValue> =
            tuple_parts::<N>(ron).ok_or_else(|| expected(&Self::kind(), ron))?;
        let mut values = <[T; N]>::default();
        for (value, part) in values.iter_mut().zip(parts) {
            *value = T::parse(part.get_ron())?;
        }
        Ok(values)
    }
    fn show(&self) -> String {
        let mut text = String::from("(");
        for (i, value) in self.iter().enumerate() {
            let _ = write!(text, "{}{}", if i > 0 { ", " } else { "" }, value.show());
        }
        text + ")"
    }
}

fn tuple_parts<const N: usize>(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
    fn as_two(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
        ron::from_str::<(&ron::value::RawValue, &ron::value::RawValue)>(ron)
            .ok()
            .map(|t| vec![t.0, t.1])
    }
    fn as_three(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
        type Raw<'a> = &'a ron::value::RawValue;
        ron::from_str::<(Raw<'_>, Raw<'_>, Raw<'_>)>(ron).ok().map(|t| vec![t.0, t.1, t.2])
    }
    match N {
        2 => as_two(ron),
        3 => as_three(ron),
        _ => None,
    }
}

/// An optional parameter: `None`, or the value itself.
impl<T: ParamValue> ParamValue for Option<T> {
    fn kind() -> String {
        format!("{} or None", T::kind())
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let text = ron.trim();
        if text == "None" {
            return Ok(None);
        }
        let inner = text.strip_prefix("Some(").and_then(|t| t.strip_suffix(')')).unwrap_or(text);
        T::parse(inner).map(Some)
    }
    fn show(&self) -> String {
        self.as_ref().map_or_else(|| "None".into(), T::show)
    }
    fn path(&mut self) -> Option<&mut PathBuf> {
        self.as_mut().and_then(T::path)
    }
}

/// Declares a node's parameters: documentation, name, type, default and range on one line each.
///
/// ```
/// lightloom_nodes::params! {
///     /// Splits things.
///     pub struct Splits {
///         /// How many.
///         count: u32 = 200, 1..=65_536;
///         /// Seed of every random choice.
///         seed: u64 = 1;
///         /// Must be given: no default.
///         file: lightloom_nodes::node::File;
///     }
/// }
/// use lightloom_nodes::node::Params;
/// let mut splits = Splits::default();
/// assert!(splits.set("count", "0").unwrap_err().contains("1..=65_536"));
/// assert!(splits.set("count", "7").is_ok() && splits.count == 7);
/// ```
#[macro_export]
macro_rules! params {
    (
        $(#[doc = $doc:literal])*
        pub struct $name:ident {
            $( $(#[doc = $fdoc:literal])* $field:ident : $ty:ty $(= $default:expr $(, $range:expr)?)? ; )*
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name { $( $(#[doc = $fdoc])* pub $field: $ty, )* }

        impl Default for $name {
            fn default() -> Self {
                $name { $( $field: $crate::params!(@default $ty $(, $default)?), )* }
            }
        }

        impl $crate::node::Params for $name {
            fn doc() -> String {
                [$($doc),*].map(str::trim).join("\n")
            }
            fn specs() -> Vec<$crate::node::ParamSpec> {
                vec![$( $crate::node::ParamSpec {
                    name: stringify!($field),
                    kind: <$ty as $crate::node::ParamValue>::kind(),
                    default: $crate::params!(@shown $ty $(, $default)?),
                    range: $crate::params!(@range $($(, $range)?)?),
                    doc: [$($fdoc),*].map(str::trim).join(" "),
                }, )*]
            }
            fn set(&mut self, name: &str, ron: &str) -> Result<(), String> {
                match name {
                    $( stringify!($field) => {
                        let value = <$ty as $crate::node::ParamValue>::parse(ron)?;
                        $($( if !($range).contains(&value) {
                            return Err(format!("expected a value in {}, found `{}`", stringify!($range), ron.trim()));
                        } )?)?
                        self.$field = value;
                        Ok(())
                    } )*
                    _ => {
                        let _ = ron;
                        Err(format!("there is no parameter `{name}`"))
                    }
                }
            }
            fn canonical(&self) -> Vec<(&'static str, String)> {
                let mut all = vec![$( (
                    stringify!($field),
                    <$ty as $crate::node::ParamValue>::path(&mut self.$field.clone()).is_none(),
                    <$ty as $crate::node::ParamValue>::show(&self.$field),
                ), )*];
                all.retain(|(_, keep, _)| *keep);
                all.into_iter().map(|(name, _, text): (&'static str, bool, String)| (name, text)).collect()
            }
            fn files(&self) -> Vec<std::path::PathBuf> {
                let paths: Vec<Option<std::path::PathBuf>> = vec![
                    $( <$ty as $crate::node::ParamValue>::path(&mut self.$field.clone()).cloned(), )*
                ];
                paths.into_iter().flatten().collect()
            }
            fn resolve(&mut self, folder: &std::path::Path) {
                let _ = folder;
                $( if let Some(path) = <$ty as $crate::node::ParamValue>::path(&mut self.$field) {
                    *path = folder.join(&*path);
                } )*
            }
        }
    };
    (@default $ty:ty) => { <$ty>::default() };
    (@default $ty:ty, $default:expr) => { $default };
    (@shown $ty:ty) => { None };
    (@shown $ty:ty, $default:expr) => { Some(<$ty as $crate::node::ParamValue>::show(&$default)) };
    (@range) => { None };
    (@range, $range:expr) => { Some(stringify!($range)) };
}

/// Declares a parameter type that is one of a few words; the first is the default.
#[macro_export]
macro_rules! choice {
    ( $(#[$meta:meta])* pub enum $name:ident { $( $(#[doc = $doc:literal])* $variant:ident = $word:literal ),* $(,)? } ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $( $(#[doc = $doc])* $variant ),* }
        impl Default for $name {
            fn default() -> Self { <$name as $crate::node::Choice>::WORDS[0].1 }
        }
        impl $crate::node::Choice for $name {
            const WORDS: &'static [(&'static str, Self)] = &[$( ($word, $name::$variant) ),*];
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::choice! {
        /// A test's choice.
        pub enum Pick { /// Largest.
            Max = "max", /// Any.
            Random = "random" }
    }

    crate::params! {
        /// A test's node.
        pub struct Probe {
            /// Size in pixels.
            size: [u32; 2] = [640, 360];
            /// A length in metres.
            reach: f32 = 0.5, 0.0..=1.0;
            /// Which.
            pick: Pick = Pick::Max;
            /// What to read.
            file: File;
            /// Perhaps.
            map: Option<File> = None;
        }
    }

    #[test]
    fn reads_and_refuses() {
        let mut probe = Probe::default();
        for (name, text) in
            [("size", "(64, 36)"), ("reach", "1e-1"), ("pick", "random"), ("file", "\"a.glb\"")]
        {
            probe.set(name, text).unwrap();
        }
        assert_eq!((probe.size, probe.reach, probe.pick), ([64, 36], 0.1, Pick::Random));
        for (name, text, part) in [
            ("size", "(64, 36, 1)", "(integer, integer)"),
            ("reach", "1.5", "0.0..=1.0"),
            ("reach", "1e39", "at most"),
            ("reach", "1e-46", "at least"),
            ("reach", "NaN", "finite"),
            ("pick", "best", "max | random"),
            ("file", "7", "path in quotes"),
            ("nothing", "7", "no parameter"),
        ] {
            let error = probe.set(name, text).unwrap_err();
            assert!(error.contains(part), "{name}: {error}");
        }
    }

    #[test]
    fn canonical_text_leaves_paths_out() {
        let mut probe = Probe::default();
        probe.set("reach", "-0.0").unwrap();
        probe.set("map", "\"sky.hdr\"").unwrap();
        probe.resolve(Path::new("folder"));
        assert_eq!(
            probe.canonical(),
            [("size", "(640, 360)".into()), ("reach", "0.0".into()), ("pick", "max".to_owned())]
        );
        assert_eq!(probe.files()[1], Path::new("folder/sky.hdr"));
        assert_eq!(Probe::specs()[3].default, None);
    }
}
