//! Tests of every shader, and the comparison of WGSL structs with their Rust mirrors.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{
    AddressSpace, ArraySize, Handle, Module, Scalar, ScalarKind, StorageAccess, Type, TypeInner,
};
use std::fmt::{Debug, Display};

/// A member of a struct.
#[derive(Debug, PartialEq)]
pub struct Member {
    pub name: String,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Its type as Rust writes it.
    pub kind: String,
}

/// The members of a Rust struct, which must all be named: one that is forgotten does not compile.
macro_rules! members {
    ($mirror:ident { $($field:ident),+ }) => {{
        let $mirror { $($field),+ } = $mirror::zeroed();
        vec![$($crate::layout::Member {
            name: stringify!($field).to_owned(),
            offset: std::mem::offset_of!($mirror, $field),
            kind: std::any::type_name_of_val(&$field).to_owned(),
        }),+]
    }};
}
pub(crate) use members;

/// The module of a WGSL source.
pub fn parse(source: &str) -> Module {
    naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)))
}

/// What differs between the WGSL struct `name` and its mirror `T` with `members`, of which those
/// called `padding` exist in Rust only.
pub fn differences<T>(module: &Module, name: &str, members: &[Member]) -> Vec<String> {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
    let Some((_, Type { inner: TypeInner::Struct { members: theirs, span }, .. })) = found else {
        return vec![format!("no struct {name}")];
    };
    let theirs: Vec<Member> = theirs
        .iter()
        .map(|member| Member {
            name: member.name.clone().unwrap_or_default(),
            offset: member.offset as usize,
            kind: kind(module, member.ty),
        })
        .collect();
    let ours: Vec<&Member> = members.iter().filter(|member| member.name != "padding").collect();
    let mut differences = Vec::new();
    compare(&mut differences, "size", *span as usize, size_of::<T>());
    compare(&mut differences, "members", theirs.len(), ours.len());
    for (theirs, ours) in theirs.iter().zip(ours) {
        compare(&mut differences, &ours.name, theirs, ours);
    }
    differences
}

fn compare<T: Debug + PartialEq>(
    differences: &mut Vec<String>,
    what: impl Display,
    wgsl: T,
    rust: T,
) {
    if wgsl != rust {
        differences.push(format!("{what}: {wgsl:?} in WGSL, {rust:?} in Rust"));
    }
}

/// A WGSL type as Rust writes its mirror.
fn kind(module: &Module, ty: Handle<Type>) -> String {
    match module.types[ty].inner {
        TypeInner::Scalar(of) => scalar(of),
        TypeInner::Vector { size, scalar: of } => format!("[{}; {}]", scalar(of), size as u32),
        TypeInner::Array { base, size: ArraySize::Constant(size), .. } => {
            format!("[{}; {size}]", kind(module, base))
        }
        ref other => format!("{other:?}"),
    }
}

fn scalar(scalar: Scalar) -> String {
    let letter = match scalar.kind {
        ScalarKind::Float => "f",
        ScalarKind::Uint => "u",
        ScalarKind::Sint => "i",
        _ => "?",
    };
    format!("{letter}{}", scalar.width * 8)
}

/// The bindings of group 0 in the order of their numbers: number, name, address space and, of
/// arrays, the stride in bytes.
pub fn bindings(module: &Module) -> Vec<String> {
    let mut bindings: Vec<(u32, String)> = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        let Some(binding) = variable.binding.filter(|binding| binding.group == 0) else { continue };
        let space = match variable.space {
            AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                "storage read write"
            }
            AddressSpace::Storage { .. } => "storage read",
            AddressSpace::Uniform => "uniform",
            _ => "other",
        };
        let stride = match module.types[variable.ty].inner {
            TypeInner::Array { stride, .. } => format!(", stride {stride}"),
            _ => String::new(),
        };
        let name = variable.name.as_deref().unwrap_or_default();
        bindings.push((binding.binding, format!("{} {name}: {space}{stride}", binding.binding)));
    }
    bindings.sort();
    bindings.into_iter().map(|(_, text)| text).collect()
}

/// Validates a module with nothing beyond what WebGPU promises.
fn validate(source: &str) -> Result<(), String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    validator.validate(&module).map_err(|e| e.emit_to_string(source))?;
    Ok(())
}

#[test]
fn every_shader_of_the_folder_is_valid() {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(env!("CARGO_MANIFEST_DIR")).expect("the package's folder") {
        let path = entry.expect("an entry of the package's folder").path();
        if path.extension().is_some_and(|extension| extension == "wgsl") {
            let source = std::fs::read_to_string(&path).expect("a readable shader");
            assert_eq!(validate(&source), Ok(()), "{}", path.display());
            names.push(path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        }
    }
    assert!(names.contains(&"element.wgsl".to_owned()), "{names:?}");
}

#[test]
fn validation_finds_errors() {
    assert!(validate("fn broken(").is_err());
    assert!(
        validate("@group(0) @binding(0) var<uniform> tight: array<array<f32, 3>, 4>;").is_err()
    );
}
