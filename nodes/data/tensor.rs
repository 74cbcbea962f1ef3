//! Sampled rows of the lighting tensor, its clustering, and the representatives.

use super::Array;
use crate::artifact;
use glam::Vec3;

artifact! {
    /// Sampled rows of one frame: a slice of the reduced tensor R (Hašan et al. 2008, section 4.3).
    pub struct Rows {
        /// `[light, row]` 2-norms of the RGB elements; rows fastest.
        reduced: Array<f32>,
        /// `[light, 3]` per-channel norms of the columns, needed for the reconstruction.
        norm: Array<Vec3>,
        /// `[row]` pixel of each row; [`NONE`](super::NONE) for a dark row where a bin sees no surface.
        pixel: Array<u32>,
        /// 1 when light j means the same light in every frame.
        identity: u8,
    }
}

artifact! {
    /// A clustering of light-frame pairs with its whole split history, so that every smaller count
    /// is answered without clustering again (Hašan et al. 2008, section 4.3.2).
    pub struct Clusters {
        /// Lights of all clusters: every cluster's lights are a range of it.
        member: Array<u32>,
        /// `[start, 4]` clusters before any split: first place in `member`, number of lights, first
        /// frame, one past the last.
        start: Array<[u32; 4]>,
        /// `[dark, 4]` the same for lights that reach no row: they render nothing.
        dark: Array<[u32; 4]>,
        /// `[split, 3]`: number of the cluster, 0 in lights or 1 in time, place: the lights that stay,
        /// or the frame at which the new cluster begins. The new cluster is numbered after all others.
        split: Array<[u32; 3]>,
        /// `[1 + splits]` total cost before the first and after each split.
        cost: Array<f64>,
        /// Number of lights.
        lights: u32,
        /// Number of frames.
        frames: u32,
    }
}

artifact! {
    /// One representative light-frame pair for each cluster, and the reconstruction matrix
    /// (Hašan et al. 2008, section 4.5). Sorted by frame, then light.
    pub struct Representatives {
        /// `[representative, 2]`: light, frame.
        pair: Array<[u32; 2]>,
        /// `[representative, 2]`: first and end of the frames it serves.
        frames: Array<[u32; 2]>,
        /// `[representative]` first row of its weights in `weight`, one for each frame it serves.
        first_weight: Array<u32>,
        /// `[weight, 3]` entries of Rec: factor of the representative in each frame it serves, per channel.
        weight: Array<Vec3>,
        /// Number of frames.
        count: u32,
    }
}
