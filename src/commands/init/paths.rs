//! Paths of a graph file: from its folder, so that scene and graph can move together.

use crate::commands::session::Failure;
use std::path::{Component, Path, PathBuf};

/// The path of `file` from `folder`, as a string of a graph file: the two can move together.
pub fn quoted(folder: &Path, file: &Path) -> Result<String, Failure> {
    let wrong =
        |what: &dyn std::fmt::Display| Failure::Usage(format!("{}: {what}", file.display()));
    // An empty path is the current folder, which cannot be made absolute as it is.
    let [from, to] =
        [&Path::new(".").join(folder), file].map(|p| std::path::absolute(p).map(|p| tidy(&p)));
    let path = relative(&from.map_err(|e| wrong(&e))?, &to.map_err(|e| wrong(&e))?);
    let parts: Option<Vec<&str>> = path.iter().map(|part| part.to_str()).collect();
    let text = match (parts, path.has_root()) {
        (Some(parts), false) => parts.join("/"),
        _ => path
            .to_str()
            .ok_or_else(|| wrong(&"its path is not Unicode, as graph files are"))?
            .to_owned(),
    };
    // A string that starts with a dollar sign names a variable.
    Ok(if text.starts_with('$') {
        format!("{:?}", format!("./{text}"))
    } else {
        format!("{text:?}")
    })
}

/// An absolute path without `..`, as its text says.
pub fn tidy(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut tidied, part| {
        match part {
            Component::ParentDir => drop(tidied.pop()),
            part => tidied.push(part),
        }
        tidied
    })
}

/// The way from one absolute path to another; the other itself when nothing is common to them.
pub fn relative(from: &Path, to: &Path) -> PathBuf {
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return to.to_owned();
    }
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_start_at_the_graph() {
        let from = |folder: &str, file: &str| {
            quoted(Path::new(folder), Path::new(file)).unwrap_or_default()
        };
        assert_eq!(from("", "a/../b.glb"), "\"b.glb\"");
        assert_eq!(from("graphs/x", "scenes/b \"1\".glb"), "\"../../scenes/b \\\"1\\\".glb\"");
        assert_eq!(from("", "$b.glb"), "\"./$b.glb\"");
        assert_eq!(relative(Path::new("/a/b"), Path::new("/a/c/d")), Path::new("../c/d"));
    }
}
