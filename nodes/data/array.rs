//! Arrays that live in memory or in a mapped file, and the container that holds them: safetensors.

use crate::node::Error;
use bytemuck::Pod;
use safetensors::{Dtype, SafeTensors};
use std::io::Write;
use std::ops::Deref;
use std::sync::Arc;

/// A fixed-size element of an array: a number, or a small vector of numbers.
pub trait Element: Pod + Send + Sync {
    /// Type of the numbers.
    const DTYPE: Dtype;
    /// Shape of one element: empty for a number, `[3]` for a 3-vector.
    const TRAIL: &'static [usize];
}

macro_rules! elements {
    ($($t:ty = $dtype:ident $trail:expr;)*) => {$(
        impl Element for $t {
            const DTYPE: Dtype = Dtype::$dtype;
            const TRAIL: &'static [usize] = $trail;
        }
    )*};
}
elements! {
    u8 = U8 &[]; u16 = U16 &[]; u32 = U32 &[]; i32 = I32 &[]; u64 = U64 &[]; f32 = F32 &[]; f64 = F64 &[];
    glam::Vec2 = F32 &[2]; glam::Vec3 = F32 &[3];
}
impl<const N: usize> Element for [f32; N] {
    const DTYPE: Dtype = Dtype::F32;
    const TRAIL: &'static [usize] = &[N];
}
impl<const N: usize> Element for [u32; N] {
    const DTYPE: Dtype = Dtype::U32;
    const TRAIL: &'static [usize] = &[N];
}
impl<const N: usize> Element for [u8; N] {
    const DTYPE: Dtype = Dtype::U8;
    const TRAIL: &'static [usize] = &[N];
}
impl<const N: usize> Element for [u16; N] {
    const DTYPE: Dtype = Dtype::U16;
    const TRAIL: &'static [usize] = &[N];
}

/// Bytes that stay valid, unchanged and where they are for as long as they are held: a mapped blob, or a vector.
pub type Bytes = Arc<dyn AsRef<[u8]> + Send + Sync>;

enum Storage<T> {
    Owned(Vec<T>),
    Mapped(Mapped<T>),
}

/// Elements that lie in shared bytes. Where they lie is found once: loops ask for single elements.
struct Mapped<T> {
    values: *const [T],
    /// Keeps the values alive.
    bytes: Bytes,
}

// SAFETY: the values are shared and never changed, as a slice of them would be.
unsafe impl<T: Sync> Send for Mapped<T> {}
// SAFETY: as above.
unsafe impl<T: Sync> Sync for Mapped<T> {}

/// An immutable array of elements with a shape, row-major; owned, or mapped from an artifact.
pub struct Array<T> {
    shape: Vec<usize>,
    storage: Storage<T>,
}

impl<T: Element> Array<T> {
    /// An array of the given shape (without the shape of an element).
    ///
    /// # Panics
    /// When the number of values is not the product of the shape: an error of the calling code.
    pub fn shaped(values: Vec<T>, shape: &[usize]) -> Self {
        assert_eq!(
            values.len(),
            shape.iter().product::<usize>(),
            "values do not fill shape {shape:?}"
        );
        Array { shape: shape.to_vec(), storage: Storage::Owned(values) }
    }

    /// Number of elements along each axis, without the shape of an element.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }
}

impl<T: Element> From<Vec<T>> for Array<T> {
    fn from(values: Vec<T>) -> Self {
        Array { shape: vec![values.len()], storage: Storage::Owned(values) }
    }
}

impl<T: Element> Default for Array<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T: Element> FromIterator<T> for Array<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        values.into_iter().collect::<Vec<_>>().into()
    }
}

impl<T: Element> Clone for Array<T> {
    /// Shares the mapping, or copies the values.
    fn clone(&self) -> Self {
        let storage = match &self.storage {
            Storage::Owned(values) => Storage::Owned(values.clone()),
            Storage::Mapped(Mapped { values, bytes }) => {
                Storage::Mapped(Mapped { values: *values, bytes: Arc::clone(bytes) })
            }
        };
        Array { shape: self.shape.clone(), storage }
    }
}

impl<T: Element> Deref for Array<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        match &self.storage {
            Storage::Owned(values) => values,
            // SAFETY: the values lie in the bytes held beside them, which stay valid and unchanged.
            Storage::Mapped(mapped) => unsafe { &*mapped.values },
        }
    }
}

impl<T: Element + std::fmt::Debug> std::fmt::Debug for Array<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Array{:?}", self.shape)
    }
}

/// One named array as it stands in an artifact.
pub struct View<'a> {
    /// Type of the numbers.
    pub dtype: Dtype,
    /// Full shape, that of the elements included.
    pub shape: Vec<usize>,
    /// The numbers, little-endian.
    pub bytes: &'a [u8],
}

/// A field of an artifact: an [`Array`], or a single [`Element`].
pub trait Field: Sized {
    /// The field as it is written.
    fn view(&self) -> View<'_>;
    /// Reads the field called `name`.
    ///
    /// # Errors
    /// When it is missing, or of another type or shape.
    fn load(arrays: &Arrays, name: &str) -> Result<Self, Error>;
}

impl<T: Element> Field for Array<T> {
    fn view(&self) -> View<'_> {
        let shape = self.shape.iter().chain(T::TRAIL).copied().collect();
        View { dtype: T::DTYPE, shape, bytes: bytemuck::cast_slice(self) }
    }
    fn load(arrays: &Arrays, name: &str) -> Result<Self, Error> {
        let (start, end, mut shape) = arrays.find(name, T::DTYPE, T::TRAIL)?;
        shape.truncate(shape.len() - T::TRAIL.len());
        let aligned: Result<&[T], _> =
            bytemuck::try_cast_slice(&(*arrays.bytes).as_ref()[start..end]);
        let storage = match aligned {
            Ok(values) => Storage::Mapped(Mapped { values, bytes: Arc::clone(&arrays.bytes) }),
            Err(_) => {
                Storage::Owned(bytemuck::pod_collect_to_vec(&(*arrays.bytes).as_ref()[start..end]))
            }
        };
        Ok(Array { shape, storage })
    }
}

impl<T: Element> Field for T {
    fn view(&self) -> View<'_> {
        View { dtype: T::DTYPE, shape: T::TRAIL.to_vec(), bytes: bytemuck::bytes_of(self) }
    }
    fn load(arrays: &Arrays, name: &str) -> Result<Self, Error> {
        let (start, end, shape) = arrays.find(name, T::DTYPE, T::TRAIL)?;
        if shape.len() != T::TRAIL.len() {
            return Err(arrays.wrong(name, &format!("a single element, found shape {shape:?}")));
        }
        Ok(bytemuck::pod_read_unaligned(&(*arrays.bytes).as_ref()[start..end]))
    }
}

/// The named arrays of one artifact, read from safetensors bytes without copying.
pub struct Arrays {
    bytes: Bytes,
    data: &'static str,
    entries: Vec<(String, Dtype, Vec<usize>, usize, usize)>,
}

impl Arrays {
    /// Reads the header; `data` names the artifact's type in errors.
    ///
    /// # Errors
    /// When the bytes are not a safetensors file.
    pub fn parse(bytes: Bytes, data: &'static str) -> Result<Self, Error> {
        let all = (*bytes).as_ref();
        let broken = |e: safetensors::SafeTensorError| Error::invalid(format!("not a {data}: {e}"));
        let tensors = SafeTensors::deserialize(all).map_err(broken)?;
        let base = all.as_ptr() as usize;
        let entries = tensors
            .iter()
            .map(|(name, view)| {
                let start = view.data().as_ptr() as usize - base;
                (
                    name.to_owned(),
                    view.dtype(),
                    view.shape().to_vec(),
                    start,
                    start + view.data().len(),
                )
            })
            .collect();
        Ok(Arrays { bytes, data, entries })
    }

    /// Name, type and shape of every array, for people.
    pub fn describe(&self) -> Vec<(String, Dtype, Vec<usize>)> {
        self.entries
            .iter()
            .map(|(name, dtype, shape, ..)| (name.clone(), *dtype, shape.clone()))
            .collect()
    }

    fn find(
        &self,
        name: &str,
        dtype: Dtype,
        trail: &[usize],
    ) -> Result<(usize, usize, Vec<usize>), Error> {
        let Some((_, found, shape, start, end)) = self.entries.iter().find(|e| e.0 == name) else {
            return Err(self.wrong(name, "an array of that name"));
        };
        if *found != dtype || !shape.ends_with(trail) {
            return Err(self.wrong(
                name,
                &format!("{dtype:?} ending in {trail:?}, found {found:?} {shape:?}"),
            ));
        }
        Ok((*start, *end, shape.clone()))
    }

    fn wrong(&self, name: &str, expected: &str) -> Error {
        Error::invalid(format!("{}.{name}: expected {expected}", self.data))
    }
}

/// Writes named arrays as safetensors: the same arrays always give the same bytes. Arrays of wide
/// numbers come first, so that every array is aligned for its type.
///
/// # Errors
/// Those of the writer.
pub fn write_arrays(out: &mut dyn Write, arrays: &[(&str, View<'_>)]) -> std::io::Result<()> {
    let mut order: Vec<&(&str, View<'_>)> = arrays.iter().collect();
    order.sort_by_key(|(name, view)| (std::cmp::Reverse(view.dtype.bitsize()), *name));
    let mut header = serde_json::Map::new();
    let mut at = 0;
    for (name, view) in &order {
        let end = at + view.bytes.len();
        let dtype = serde_json::to_value(view.dtype)?;
        let entry =
            serde_json::json!({ "dtype": dtype, "shape": view.shape, "data_offsets": [at, end] });
        header.insert((*name).to_owned(), entry);
        at = end;
    }
    let mut text = serde_json::to_vec(&header)?;
    text.resize(text.len().next_multiple_of(8), b' ');
    out.write_all(&(text.len() as u64).to_le_bytes())?;
    out.write_all(&text)?;
    order.iter().try_for_each(|(_, view)| out.write_all(view.bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn round_trip(arrays: &[(&str, View<'_>)]) -> Arrays {
        let mut bytes = Vec::new();
        write_arrays(&mut bytes, arrays).unwrap();
        Arrays::parse(Arc::new(bytes), "Test").unwrap()
    }

    #[test]
    fn arrays_round_trip_with_shape_and_type() {
        let points = Array::shaped(vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE], &[2, 2]);
        let marks: Array<u8> = vec![1, 2, 3].into();
        let cost = 2.5_f64;
        let read = round_trip(&[
            ("points", points.view()),
            ("marks", marks.view()),
            ("cost", cost.view()),
        ]);
        let back = Array::<Vec3>::load(&read, "points").unwrap();
        assert_eq!((back.shape(), &back[..]), (&[2, 2][..], &points[..]));
        assert_eq!(&Array::<u8>::load(&read, "marks").unwrap()[..], [1, 2, 3]);
        assert_eq!(f64::load(&read, "cost").unwrap(), 2.5);
    }

    #[test]
    fn a_wrong_name_or_type_is_an_error_that_names_it() {
        let marks: Array<u8> = vec![1].into();
        let read = round_trip(&[("marks", marks.view())]);
        let text = |e: Error| e.to_string();
        assert!(
            text(Array::<f32>::load(&read, "marks").unwrap_err())
                .contains("Test.marks: expected F32")
        );
        assert!(text(Array::<u8>::load(&read, "mark").unwrap_err()).contains("Test.mark"));
        assert!(Arrays::parse(Arc::new(vec![1_u8, 2, 3]), "Test").is_err());
    }
}
