//! What flows between nodes: artifacts, each a set of named arrays stored as safetensors.

mod array;
mod framebuffer;
mod geometry;
mod image;
mod lights;
mod pbgi;
mod perception;
mod scene;
mod tensor;

pub use array::{Array, Arrays, Bytes, Element, Field, View, write_arrays};
pub use framebuffer::{Camera, DeepFramebuffer, NONE, PixelMaps};
pub use geometry::{Geometry, Materials, Poses, alpha, instance};
pub use image::{Comparison, Environment, Image, PerceptualDifferences, Picture, Ssim};
pub use lights::{GatherSamples, LightKind, Lights, Photons};
pub use pbgi::{Lut, PbgiMemory, PbgiTree, QuantizationError, RadiantSurfels, Surfels};
pub use perception::{ColorVideoVdp, Flip};
pub use scene::{Channel, Primitive, Scene, Time, channel};
pub use tensor::{Clusters, Representatives, Rows};

use crate::node::Error;

/// An artifact: the value a node gives and others take.
pub trait Data: Sized + Send + Sync + 'static {
    /// Its type's name in the catalogue.
    const TYPE: &'static str;
    /// Whether it is nothing but numbers for people: those are published, and measured by sweeps.
    const FIGURES: bool = false;
    /// Every named array, in the order of declaration.
    fn views(&self) -> Vec<(&'static str, View<'_>)>;
    /// Reads it back.
    ///
    /// # Errors
    /// When an array is missing or of another type.
    fn load(arrays: &Arrays) -> Result<Self, Error>;
}

/// The artifact's bytes; equal artifacts give equal bytes.
pub fn encode(value: &impl Data) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_arrays(&mut bytes, &value.views()).expect("writing to memory does not fail");
    bytes
}

/// Reads an artifact from its bytes, without copying its arrays.
///
/// # Errors
/// When the bytes are not such an artifact.
pub fn decode<T: Data>(bytes: Bytes) -> Result<T, Error> {
    T::load(&Arrays::parse(bytes, T::TYPE)?)
}

/// Declares an artifact: a struct of [`Array`]s and single [`Element`]s with their meaning. One that is
/// nothing but numbers for people is declared as `pub struct Name: Figures { ... }`.
#[macro_export]
macro_rules! artifact {
    (@ Figures) => { true };
    ( $(#[doc = $doc:literal])* pub struct $name:ident $(: $figures:ident)? { $( $(#[doc = $fdoc:literal])* $field:ident : $ty:ty ),* $(,)? } ) => {
        $(#[doc = $doc])*
        #[derive(Clone, Debug)]
        pub struct $name { $( $(#[doc = $fdoc])* pub $field: $ty ),* }
        impl $crate::data::Data for $name {
            const TYPE: &'static str = stringify!($name);
            $( const FIGURES: bool = $crate::artifact!(@ $figures); )?
            fn views(&self) -> Vec<(&'static str, $crate::data::View<'_>)> {
                vec![$( (stringify!($field), $crate::data::Field::view(&self.$field)) ),*]
            }
            fn load(arrays: &$crate::data::Arrays) -> Result<Self, $crate::node::Error> {
                Ok($name { $( $field: $crate::data::Field::load(arrays, stringify!($field))? ),* })
            }
        }
    };
}
