//! Parameters: each is written once, with its default, range and meaning; the catalogue, the checks,
//! the canonical text of the key and the reading of a graph file all come from that one line.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::File;

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
