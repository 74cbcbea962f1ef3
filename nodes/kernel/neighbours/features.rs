//! The 9-vectors of an image's pixels.

use glam::{Mat4, Vec4};
use rayon::prelude::*;

/// The index of no pixel: what a map holds for a pixel that has no neighbour.
pub const UNMAPPED: u32 = u32::MAX;

/// Position, normal and diffuse reflectance, each times its weight.
pub(super) type Vector = [f32; 9];

/// Images are at most this wide and high, so that squared distances in the image fit 32 bits.
const LONGEST_SIDE: u32 = 1 << 15;

/// Components beyond this are refused, so that a squared distance is always finite.
const LARGEST: f32 = 1e18;

/// Why features or maps could not be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NeighbourError {
    /// A side of the image is longer than 32,768 pixels.
    #[error(
        "an image of {width} x {height} pixels is too large for a pixel map (at most 32768 a side)"
    )]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A slice does not have one element for each pixel.
    #[error("{what} has {found} elements where the image has {expected} pixels")]
    Length {
        /// The slice.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The number of pixels.
        expected: usize,
    },
    /// The scene diagonal is not a positive finite number.
    #[error("the scene diagonal must be positive and finite, not {0}")]
    Diagonal(f64),
    /// The scene centre has a component that is not finite.
    #[error("the scene centre must be finite, not {0:?}")]
    Centre([f64; 3]),
    /// A weight is negative or not finite.
    #[error("the weights must be finite and not negative, not {0:?}")]
    Weights(Weights),
}

/// How much each part of the 9-vector counts: every component of the part is multiplied by its weight before distances are taken.
/// The paper leaves them open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Factor of the world position, which has first been divided by the scene diagonal.
    pub position: f32,
    /// Factor of the unit normal.
    pub normal: f32,
    /// Factor of the diffuse reflectance, linear RGB.
    pub albedo: f32,
}

/// One frame's deep framebuffer: slices of `width * height` elements in rows from the top.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// World-space positions.
    pub position: &'a [[f32; 3]],
    /// World-space unit normals.
    pub normal: &'a [[f32; 3]],
    /// Diffuse reflectances, linear RGB.
    pub albedo: &'a [[f32; 3]],
    /// Not zero where the pixel sees a surface.
    pub valid: &'a [u8],
}

/// The 9-vectors of an image's pixels. A pixel that sees nothing, or whose vector is not finite or has a component beyond 1e18,
/// is invalid: it is nobody's neighbour and has none.
#[derive(Debug, Clone)]
pub struct Features {
    width: u32,
    height: u32,
    /// An invalid pixel's first component is infinite, which puts it infinitely far from every query.
    vectors: Vec<Vector>,
    /// For each pixel the squared distance within which it is nearer to a query than the eight around it.
    own: Vec<f32>,
}

/// The squared distance of two 9-vectors in single precision, as every search here measures it. The order of the additions is part
/// of the definition: the pyramid's lane-parallel form adds in the same order and so gives the same bits.
#[inline]
pub fn squared_distance(a: &[f32; 9], b: &[f32; 9]) -> f32 {
    let sums = squares(a, b);
    (sums.x + sums.y) + (sums.z + sums.w)
}

/// The squared distances of four of `vectors`, each with the bits of [`squared_distance`].
#[inline(always)]
pub(super) fn squared_distances(
    vectors: &[Vector],
    [a, b, c, d]: [u32; 4],
    query: &Vector,
) -> Vec4 {
    let sums = Mat4::from_cols(
        squares(&vectors[a as usize], query),
        squares(&vectors[b as usize], query),
        squares(&vectors[c as usize], query),
        squares(&vectors[d as usize], query),
    );
    let sums = sums.transpose();
    (sums.x_axis + sums.y_axis) + (sums.z_axis + sums.w_axis)
}

/// The squared differences, those four components apart added.
#[inline(always)]
fn squares(a: &Vector, b: &Vector) -> Vec4 {
    let square = |group: usize| {
        let difference = Vec4::from_slice(&a[4 * group..]) - Vec4::from_slice(&b[4 * group..]);
        difference * difference
    };
    let last = a[8] - b[8];
    square(0) + square(1) + Vec4::new(last * last, 0.0, 0.0, 0.0)
}

/// Whether a vector can be searched for without an overflow.
pub(super) fn searchable(vector: &Vector) -> bool {
    vector.iter().all(|component| component.abs() <= LARGEST)
}

impl Features {
    /// The vectors `((position - centre) / diagonal, normal, albedo)`, each part times its weight. `diagonal` is the length of the
    /// scene's bounding box diagonal and `centre` a point in the scene's midst, both in world units; they must be the same for all
    /// frames that are compared. The centre is subtracted in double precision, so a scene far from the origin loses nothing that
    /// its single-precision positions still hold.
    ///
    /// Fails when a slice's length is not the number of pixels, a side is longer than 32,768, or the diagonal, centre or weights
    /// are not usable numbers.
    pub fn new(
        frame: &Frame,
        centre: [f64; 3],
        diagonal: f64,
        weights: Weights,
    ) -> Result<Self, NeighbourError> {
        let Frame { width, height, position, normal, albedo, valid } = *frame;
        if width > LONGEST_SIDE || height > LONGEST_SIDE {
            return Err(NeighbourError::TooLarge { width, height });
        }
        let expected = width as usize * height as usize;
        let lengths = [
            ("position", position.len()),
            ("normal", normal.len()),
            ("albedo", albedo.len()),
            ("valid", valid.len()),
        ];
        for (what, found) in lengths {
            if found != expected {
                return Err(NeighbourError::Length { what, found, expected });
            }
        }
        if !(diagonal.is_finite() && diagonal > 0.0) {
            return Err(NeighbourError::Diagonal(diagonal));
        }
        if centre.iter().any(|c| !c.is_finite()) {
            return Err(NeighbourError::Centre(centre));
        }
        if [weights.position, weights.normal, weights.albedo]
            .iter()
            .any(|w| !(w.is_finite() && *w >= 0.0))
        {
            return Err(NeighbourError::Weights(weights));
        }
        let vector = |pixel: usize| {
            let mut vector = [0.0; 9];
            for axis in 0..3 {
                let offset = (f64::from(position[pixel][axis]) - centre[axis]) / diagonal;
                vector[axis] = (offset * f64::from(weights.position)) as f32;
                vector[3 + axis] = normal[pixel][axis] * weights.normal;
                vector[6 + axis] = albedo[pixel][axis] * weights.albedo;
            }
            let usable = valid[pixel] != 0 && searchable(&vector);
            if usable { vector } else { INVALID }
        };
        let vectors: Vec<Vector> = (0..expected).into_par_iter().map(vector).collect();
        let own = |pixel: usize| own(&vectors, [width as usize, height as usize], pixel);
        let own = (0..expected).into_par_iter().map(own).collect();
        Ok(Self { width, height, vectors, own })
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixel's weighted 9-vector, or none when the pixel is invalid or not in the image.
    pub fn vector(&self, pixel: u32) -> Option<[f32; 9]> {
        self.valid(pixel).copied()
    }

    /// The pixel's vector, or none when the pixel is invalid or not in the image.
    pub(super) fn valid(&self, pixel: u32) -> Option<&Vector> {
        self.vectors.get(pixel as usize).filter(|vector| vector[0].is_finite())
    }

    /// The squared distance below which a query is nearer to the pixel than to any of the eight around it; 0 where that
    /// is not known.
    pub(super) fn own(&self, pixel: u32) -> f32 {
        self.own[pixel as usize]
    }

    /// The vectors of all pixels; an invalid pixel's is infinitely far from every valid one.
    pub(super) fn vectors(&self) -> &[Vector] {
        &self.vectors
    }
}

/// A quarter of the squared distance to the nearest of the eight pixels around one: by the triangle inequality a query
/// that is closer has none of them nearer. A little less, for rounding; 0 where squares lose their precision.
fn own(vectors: &[Vector], [width, height]: [usize; 2], pixel: usize) -> f32 {
    let (x, y) = (pixel % width, pixel / width);
    let mut least = f32::INFINITY;
    for row in y.saturating_sub(1)..height.min(y + 2) {
        for column in x.saturating_sub(1)..width.min(x + 2) {
            if (column, row) != (x, y) {
                least =
                    least.min(squared_distance(&vectors[pixel], &vectors[row * width + column]));
            }
        }
    }
    if least > 1e-25 { least.min(f32::MAX) * (0.25 - 1e-5) } else { 0.0 }
}

/// The vector of an invalid pixel.
const INVALID: Vector = [f32::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

#[cfg(test)]
mod tests {
    use super::*;

    const ONES: Weights = Weights { position: 1.0, normal: 1.0, albedo: 1.0 };

    fn one_pixel(
        position: [f32; 3],
        valid: u8,
        centre: [f64; 3],
        diagonal: f64,
        weights: Weights,
    ) -> Option<[f32; 9]> {
        let frame = Frame {
            width: 1,
            height: 1,
            position: &[position],
            normal: &[[0.0, 1.0, 0.0]],
            albedo: &[[0.25, 0.5, 0.75]],
            valid: &[valid],
        };
        Features::new(&frame, centre, diagonal, weights)
            .expect("the arguments are in order")
            .vector(0)
    }

    #[test]
    fn vectors_are_centred_scaled_and_weighted() {
        let weights = Weights { position: 2.0, normal: 3.0, albedo: 4.0 };
        let vector = one_pixel([3.0, 5.0, 7.0], 1, [1.0, 1.0, 1.0], 8.0, weights);
        assert_eq!(vector, Some([0.5, 1.0, 1.5, 0.0, 3.0, 0.0, 1.0, 2.0, 3.0]));
    }

    #[test]
    fn far_from_the_origin_nothing_is_lost() {
        // 1/16 is the spacing of single-precision numbers at 1e6.
        let vector = one_pixel([1e6 + 0.0625, 1e6, 1e6], 1, [1e6, 1e6, 1e6], 1.0, ONES);
        assert_eq!(vector.map(|v| [v[0], v[1], v[2]]), Some([0.0625, 0.0, 0.0]));
    }

    #[test]
    fn background_and_unusable_vectors_are_invalid() {
        assert_eq!(one_pixel([0.0; 3], 0, [0.0; 3], 1.0, ONES), None);
        assert_eq!(one_pixel([0.0, f32::NAN, 0.0], 1, [0.0; 3], 1.0, ONES), None);
        assert_eq!(one_pixel([0.0, 0.0, f32::INFINITY], 1, [0.0; 3], 1.0, ONES), None);
        assert_eq!(one_pixel([1.0, 0.0, 0.0], 1, [0.0; 3], 1e-30, ONES), None);
        assert!(one_pixel([1.0, 0.0, 0.0], 1, [0.0; 3], 1.0, ONES).is_some());
    }

    #[test]
    fn bad_arguments_are_refused() {
        let frame = Frame {
            width: 1,
            height: 1,
            position: &[[0.0; 3]],
            normal: &[[0.0; 3]],
            albedo: &[[0.0; 3]],
            valid: &[1],
        };
        let new = |frame: &Frame, diagonal, weights| {
            Features::new(frame, [0.0; 3], diagonal, weights).err()
        };
        assert_eq!(new(&frame, 0.0, ONES), Some(NeighbourError::Diagonal(0.0)));
        assert!(matches!(new(&frame, f64::NAN, ONES), Some(NeighbourError::Diagonal(_))));
        let negative = Weights { normal: -1.0, ..ONES };
        assert_eq!(new(&frame, 1.0, negative), Some(NeighbourError::Weights(negative)));
        let short = Frame { valid: &[], ..frame };
        assert_eq!(
            new(&short, 1.0, ONES),
            Some(NeighbourError::Length { what: "valid", found: 0, expected: 1 })
        );
        let wide = Frame { width: 40_000, ..frame };
        assert_eq!(
            new(&wide, 1.0, ONES),
            Some(NeighbourError::TooLarge { width: 40_000, height: 1 })
        );
        assert!(Features::new(&frame, [f64::INFINITY, 0.0, 0.0], 1.0, ONES).is_err());
    }

    #[test]
    fn empty_image() {
        let frame =
            Frame { width: 0, height: 5, position: &[], normal: &[], albedo: &[], valid: &[] };
        let features =
            Features::new(&frame, [0.0; 3], 1.0, ONES).expect("an empty image is an image");
        assert_eq!(features.vector(0), None);
    }
}
