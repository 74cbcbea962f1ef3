//! Surfels, their tables of node data vectors, and trees over them (Buchholz and Boubekeur 2012).

use super::Array;
use crate::artifact;
use glam::{Vec2, Vec3};

artifact! {
    /// Discs that cover all surfaces, tied to their triangles.
    pub struct Surfels {
        /// `[surfel]` triangle of each.
        triangle: Array<u32>,
        /// `[surfel, 2]` barycentric weights of the triangle's second and third corner.
        barycentric: Array<Vec2>,
        /// `[surfel]` 1 on the front of the triangle, 0 on its back.
        front: Array<u8>,
        /// `[surfel]` the area it stands for over that of its triangle.
        share: Array<f32>,
        /// `[surfel]` radius of the disc it is drawn as over the root of its area: large enough to leave
        /// no hole.
        spread: Array<f32>,
    }
}

artifact! {
    /// Surfels with the light they reflect.
    pub struct RadiantSurfels {
        /// `[surfel, 3]` world space, metres.
        position: Array<Vec3>,
        /// `[surfel, 3]` unit normal of the side that reflects.
        normal: Array<Vec3>,
        /// `[surfel, 3]` radiance it sends, the same in all directions of its side, linear Rec. 709.
        radiance: Array<Vec3>,
        /// `[surfel]` the area it stands for, square metres.
        area: Array<f32>,
        /// `[surfel]` radius of its disc, metres.
        radius: Array<f32>,
    }
}

artifact! {
    /// A table of node data vectors (LUT): spherical harmonics of red, green, blue and projected area.
    pub struct Lut {
        /// `[entry, 4 bands^2]`
        entries: Array<f32>,
        /// Bands of the harmonics.
        bands: u32,
        /// What colours are multiplied with where an entry is compared with a vector, so that they count as
        /// much as projected area whatever the exposure; a power of two.
        balance: f32,
    }
}

artifact! {
    /// A tree of surfels that can be gathered from. Which arrays are filled depends on its shape and on
    /// the format of its leaves.
    pub struct PbgiTree {
        /// 0 binary, 1 octree.
        shape: u8,
        /// Format of leaves: 0 A, 1 B, 2 C.
        format: u8,
        /// Bands of the harmonics.
        bands: u32,
        /// Number of leaves.
        leaves: u32,
        /// `[4]` centre and radius of the root's sphere.
        root: Array<f32>,
        /// `[inner, 2]` of an octree: first inner and first leaf child.
        first: Array<[u32; 2]>,
        /// `[inner]` of an octree: number of inner children, and 16 times that of leaf children.
        counts: Array<u8>,
        /// `[inner, 4]` spheres relative to those of their parents, formats A and B.
        fine: Array<[u16; 4]>,
        /// `[inner]` area below, formats A and B.
        areas: Array<f32>,
        /// `[inner, 4]` spheres relative to those of their parents, format C.
        coarse: Array<[u8; 4]>,
        /// `[inner]` area below as half floats times `area_scale`, format C.
        coarse_areas: Array<u16>,
        /// Scale of `coarse_areas`.
        area_scale: f32,
        /// `[leaf, 3]` places, format A.
        world: Array<Vec3>,
        /// `[leaf]` places in the parent's sphere, formats B and C.
        parent: Array<u16>,
        /// `[leaf, 7]` colour, normal and area as half floats, formats A and B.
        half: Array<[u16; 7]>,
        /// `[leaf, 8]` colour, normal, area and radius, format C.
        lean: Array<[u8; 8]>,
        /// What leaves share: scales of radiance and area and the spread of discs; for format C the scale
        /// of radiance and the tables of 256 areas and 256 radii.
        scales: Array<f32>,
        /// `[row, 4 bands^2]` vectors: of the inner nodes, or the table.
        rows: Array<f32>,
        /// Packed places of the inner nodes in the table; empty where each has a row of its own.
        indices: Array<u64>,
    }
}

artifact! {
    /// What a tree takes in memory, in megabytes of 10^6 bytes: as the paper counts (Table 1) and in truth.
    pub struct PbgiMemory: Figures {
        /// Paper's count: vectors of all inner nodes.
        paper_vectors: f64,
        /// Paper's count: indices in their place.
        paper_indices: f64,
        /// Paper's count: the whole tree with vectors.
        paper_full: f64,
        /// Paper's count: the whole tree with indices.
        paper_quantized: f64,
        /// Paper's count: the ratio of the last two.
        paper_ratio: f64,
        /// In truth, with the table and the projected area: the tree with vectors and leaves of format A.
        full: f64,
        /// In truth: this tree.
        stored: f64,
        /// The ratio of the last two.
        ratio: f64,
    }
}

artifact! {
    /// How far the vectors of a tree's inner nodes are from the entries that stand for them (Figure 4).
    pub struct QuantizationError: Figures {
        /// Mean over nodes of the mean of |difference| over the vector.
        mean_l1: f64,
        /// Mean over nodes of the 2-norm of the difference.
        mean_l2: f64,
        /// The largest 2-norm.
        worst_l2: f64,
    }
}
