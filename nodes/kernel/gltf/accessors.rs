//! Typed, checked reading of accessors: strides, sparse overrides, normalised integers, and the
//! zeros of accessors that have no bytes.

use super::buffers::{Buffers, View};
use super::container::Document;
use crate::node::Error;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use std::cell::Cell;

/// Elements that accessors without any bytes may claim together. Such an accessor costs a file
/// nothing, so its length proves nothing.
const UNBACKED: u64 = 1 << 26;

/// Longest element: a 4x4 matrix of f32.
const LONGEST: usize = 64;
static ZEROS: [u8; LONGEST] = [0; LONGEST];

/// Opens accessors of one file.
pub(super) struct Accessors<'a> {
    document: &'a Document,
    buffers: &'a Buffers,
    unbacked: Cell<u64>,
}

/// One accessor: all of its elements lie within its buffers.
pub(super) struct Accessor<'a> {
    index: usize,
    /// Number of elements.
    pub(super) count: usize,
    width: usize,
    component: ComponentType,
    normalized: bool,
    bytes: Option<&'a [u8]>,
    stride: usize,
    size: usize,
    sparse_rows: Vec<u32>,
    sparse_values: &'a [u8],
}

fn component_size(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

fn width(kind: Type) -> usize {
    match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

/// `bytes[offset..]` when `count` elements of `size` bytes, `stride` apart, fit in it.
fn fitting(bytes: &[u8], offset: u64, count: u64, stride: usize, size: usize) -> Option<&[u8]> {
    let rest = bytes.get(usize::try_from(offset).ok()?..)?;
    let needed = match count.checked_sub(1) {
        None => 0,
        Some(steps) => steps.checked_mul(stride as u64)?.checked_add(size as u64)?,
    };
    (needed <= rest.len() as u64).then_some(rest)
}

fn integer(component: ComponentType, bytes: &[u8]) -> u32 {
    match component {
        ComponentType::U8 | ComponentType::I8 => u32::from(bytes[0]),
        ComponentType::U16 | ComponentType::I16 => {
            u32::from(u16::from_le_bytes([bytes[0], bytes[1]]))
        }
        ComponentType::U32 | ComponentType::F32 => {
            u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        }
    }
}

/// A float, or a normalised integer as section 3.11 of the glTF 2.0 specification maps it.
fn real(component: ComponentType, bytes: &[u8]) -> f32 {
    match component {
        ComponentType::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        ComponentType::U8 => f32::from(bytes[0]) / 255.0,
        ComponentType::I8 => (f32::from(bytes[0].cast_signed()) / 127.0).max(-1.0),
        ComponentType::U16 => f32::from(u16::from_le_bytes([bytes[0], bytes[1]])) / 65535.0,
        ComponentType::I16 => {
            (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])) / 32767.0).max(-1.0)
        }
        ComponentType::U32 => integer(component, bytes) as f32,
    }
}

impl<'a> Accessors<'a> {
    pub(super) fn new(document: &'a Document, buffers: &'a Buffers) -> Self {
        Accessors { document, buffers, unbacked: Cell::new(UNBACKED) }
    }

    fn view(&self, index: usize) -> Result<View<'a>, Error> {
        self.buffers.view(self.document, index)
    }

    /// Whether the accessor numbered `index` has bytes of its own.
    pub(super) fn has_data(&self, index: usize) -> bool {
        self.document
            .accessors
            .get(index)
            .is_some_and(|a| a.buffer_view.is_some() || a.sparse.is_some())
    }

    /// The accessor numbered `index`, checked against its buffers.
    pub(super) fn open(&self, index: usize) -> Result<Accessor<'a>, Error> {
        let wrong = |what: &str| Error::invalid(format!("accessors[{index}] {what}"));
        let accessor = self.document.accessors.get(index).ok_or_else(|| wrong("does not exist"))?;
        let (Checked::Valid(component), Checked::Valid(kind)) =
            (accessor.component_type, accessor.type_)
        else {
            return Err(wrong("has an unknown type"));
        };
        let width = width(kind);
        let size = width * component_size(component.0);
        let count = accessor.count.0;
        let past = || wrong("is past the end of its buffer view");
        let (bytes, stride) = match accessor.buffer_view {
            Some(view) => {
                let view = self.view(view.value())?;
                let stride = view.stride.unwrap_or(size);
                if stride < size {
                    return Err(wrong(&format!(
                        "has elements of {size} bytes only {stride} bytes apart"
                    )));
                }
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                (Some(fitting(view.bytes, offset, count, stride, size).ok_or_else(past)?), stride)
            }
            None => {
                let left = self.unbacked.get().checked_sub(count);
                self.unbacked.set(
                    left.ok_or_else(|| wrong(&format!("claims {count} elements without data")))?,
                );
                (None, size)
            }
        };
        let mut opened = Accessor {
            index,
            count: usize::try_from(count).map_err(|_| past())?,
            width,
            component: component.0,
            normalized: accessor.normalized,
            bytes,
            stride,
            size,
            sparse_rows: Vec::new(),
            sparse_values: &[],
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(kind) = sparse.indices.component_type else {
                return Err(wrong("has sparse indices of an unknown type"));
            };
            let past = || wrong("has sparse data past the end of its buffer view");
            let n = sparse.count.0;
            let step = component_size(kind.0);
            let rows = self.view(sparse.indices.buffer_view.value())?.bytes;
            let rows =
                fitting(rows, sparse.indices.byte_offset.0, n, step, step).ok_or_else(past)?;
            let values = self.view(sparse.values.buffer_view.value())?.bytes;
            opened.sparse_values =
                fitting(values, sparse.values.byte_offset.0, n, size, size).ok_or_else(past)?;
            opened.sparse_rows =
                rows.chunks_exact(step).take(n as usize).map(|b| integer(kind.0, b)).collect();
            let increasing = opened.sparse_rows.is_sorted_by(|a, b| a < b);
            if !increasing
                || opened.sparse_rows.last().is_some_and(|last| u64::from(*last) >= count)
            {
                return Err(wrong("has sparse indices that do not increase or are past its end"));
            }
        }
        Ok(opened)
    }
}

impl Accessor<'_> {
    fn wrong(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(format!("accessors[{}] {what}", self.index))
    }

    /// The bytes of one element; `row` is below `count`.
    fn element(&self, row: usize) -> &[u8] {
        let sparse =
            u32::try_from(row).ok().and_then(|row| self.sparse_rows.binary_search(&row).ok());
        if let Some(at) = sparse {
            return &self.sparse_values[at * self.size..][..self.size];
        }
        self.bytes.map_or(&ZEROS[..self.size], |bytes| &bytes[row * self.stride..][..self.size])
    }

    fn rows<'r>(&self, rows: Option<&'r [u32]>) -> Box<dyn ExactSizeIterator<Item = usize> + 'r> {
        match rows {
            None => Box::new(0..self.count),
            Some(rows) => Box::new(rows.iter().map(|row| *row as usize)),
        }
    }

    /// Vectors of `N` finite numbers: all of them, or those of `rows` (each below `count`). Integers
    /// are taken only where `normalised` says that the format allows them, and only as fractions.
    pub(super) fn vectors<const N: usize>(
        &self,
        normalised: bool,
        rows: Option<&[u32]>,
    ) -> Result<Vec<[f32; N]>, Error> {
        let fraction = normalised && self.normalized && self.component != ComponentType::U32;
        if self.width != N || !(self.component == ComponentType::F32 || fraction) {
            let kinds = if normalised { "floats or normalised integers" } else { "floats" };
            return Err(
                self.wrong(format_args!("is {}, expected {N} {kinds} an element", self.kind()))
            );
        }
        let step = component_size(self.component);
        let mut vectors = Vec::with_capacity(rows.map_or(self.count, <[u32]>::len));
        for row in self.rows(rows) {
            let bytes = self.element(row);
            let vector = std::array::from_fn(|i| real(self.component, &bytes[i * step..]));
            if !vector.iter().all(|v: &f32| v.is_finite()) {
                return Err(
                    self.wrong(format_args!("has a number that is not finite in element {row}"))
                );
            }
            vectors.push(vector);
        }
        Ok(vectors)
    }

    /// Whether it holds vectors of `N` numbers.
    pub(super) fn is_wide(&self, n: usize) -> bool {
        self.width == n
    }

    /// Vertex indices.
    pub(super) fn indices(&self) -> Result<Vec<u32>, Error> {
        let unsigned =
            matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        if self.width != 1 || !unsigned {
            return Err(self.wrong(format_args!(
                "is {}, expected one unsigned integer an element",
                self.kind()
            )));
        }
        Ok(self.rows(None).map(|row| integer(self.component, self.element(row))).collect())
    }

    /// Joint numbers of the vertices of `rows`.
    pub(super) fn joints(&self, rows: &[u32]) -> Result<Vec<[u16; 4]>, Error> {
        if self.width != 4 || !matches!(self.component, ComponentType::U8 | ComponentType::U16) {
            return Err(
                self.wrong(format_args!("is {}, expected 4 unsigned bytes or shorts", self.kind()))
            );
        }
        let step = component_size(self.component);
        let joint = |bytes: &[u8], i: usize| integer(self.component, &bytes[i * step..]) as u16;
        let vector = |row| std::array::from_fn(|i| joint(self.element(row), i));
        Ok(self.rows(Some(rows)).map(vector).collect())
    }

    fn kind(&self) -> String {
        let normalised = if self.normalized { "normalised " } else { "" };
        format!("{} x {normalised}{:?}", self.width, self.component)
    }
}
