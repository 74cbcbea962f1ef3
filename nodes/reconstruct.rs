//! Reconstruction: representatives, scaled and mapped to the frames they serve
//! (Hašan et al. 2008, section 4.5).
//!
//! Mapping is linear, so for each representative frame the scaled columns are summed first, one sum
//! for each frame they serve, and each sum is mapped once. No column outlives its packet of pixels.

use crate::data::{Array, DeepFramebuffer, Geometry, Image, Lights, Materials, NONE, PixelMaps, Poses, Representatives};
use crate::kernel::checkpoint::Checkpoint;
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::neighbours::{Features, compose};
use crate::kernel::nine_vectors::nine_vectors;
use crate::kernel::receivers::Receivers;
use crate::kernel::stage::Stage;
use crate::kernel::visibility::Ends;
use crate::node::{All, Ctx, Error, Item, Node, Sequence, Sizes};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Receivers whose sums for all frames served fit the second-level cache.
const BLOCK: usize = 8 * Ends::CAPACITY;

crate::params! {
    /// Renders one column for each representative and adds it, scaled and mapped, to every frame it
    /// serves. Emitted light and background are added as the framebuffers have them.
    pub struct Reconstruct {
    }
}

crate::inputs! {
    /// Inputs of [`Reconstruct`].
    pub struct ReconstructIn {
        /// What to render, and the reconstruction matrix.
        representatives: Item<Representatives>,
        /// Surface samples of every frame.
        framebuffer: All<DeepFramebuffer>,
        /// Lights of every frame.
        lights: All<Lights>,
        /// Shapes that cast shadows.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are in every frame.
        poses: All<Poses>,
        /// Maps between neighbouring frames; not needed for a single frame.
        maps: Option<All<PixelMaps>>,
    }
}

impl Node for Reconstruct {
    const KIND: &'static str = "Reconstruct";
    const VERSION: u32 = 1;
    type In = ReconstructIn;
    type Out = Sequence<Image>;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A pixel takes 80 bytes in a framebuffer and 12 in each of the two images of a frame.
        inputs.bytes("framebuffer") / 80 * 24 + 8 * inputs.bytes("geometry")
    }

    fn run(&self, input: ReconstructIn, ctx: &Ctx) -> Result<Sequence<Image>, Error> {
        let frames = input.representatives.count as usize;
        // One framebuffer serves a shot in which only lights change.
        let found = input.framebuffer.len();
        if found != frames && found != 1 {
            return Err(Error::invalid(format!("representatives of {frames} frames, framebuffers of {found}")));
        }
        let first = input.framebuffer.get(0)?;
        let shape = first.triangle.shape().to_vec();
        let mut images = Vec::new();
        for k in 0..frames {
            let framebuffer = input.framebuffer.broadcast(k)?;
            if framebuffer.triangle.shape() != shape {
                return Err(Error::invalid("the framebuffers of the shot have different sizes"));
            }
            images.push(framebuffer.emitted.to_vec());
        }
        let mut checkpoint = Checkpoint::resume(ctx, &mut images);
        let total = input.representatives.pair.len() as u64;
        let done = AtomicU64::new(0);
        for source in 0..frames {
            let range = served_from(&input.representatives, source as u32);
            let next = done.load(Ordering::Relaxed) + range.len() as u64;
            if source >= checkpoint.next() && !range.is_empty() {
                let pass = Pass { input: &input, ctx, source, range, done: &done, total };
                pass.run(&mut images)?;
                checkpoint.save(source + 1, &images)?;
            }
            done.store(next, Ordering::Relaxed);
            ctx.tick(next, total)?;
        }
        let image = |radiance| Image { radiance: Array::shaped(radiance, &shape) };
        Ok(Sequence { items: images.into_iter().map(image).collect(), chunk: frames })
    }
}

/// The representatives whose column lies in frame `source`; they are sorted by frame.
fn served_from(representatives: &Representatives, source: u32) -> Range<usize> {
    let pair = &representatives.pair;
    pair.partition_point(|p| p[1] < source)..pair.partition_point(|p| p[1] <= source)
}

/// All representatives of one frame.
struct Pass<'a> {
    input: &'a ReconstructIn,
    ctx: &'a Ctx,
    source: usize,
    range: Range<usize>,
    done: &'a AtomicU64,
    total: u64,
}

impl Pass<'_> {
    fn run(&self, images: &mut [Vec<Vec3>]) -> Result<(), Error> {
        let input = self.input;
        let framebuffer = input.framebuffer.broadcast(self.source)?;
        let poses = input.poses.broadcast(self.source)?;
        let lights = input.lights.broadcast(self.source)?;
        let stage = Stage::of(self.ctx, &input.geometry, &input.materials, &poses)?;
        let tensor = RayTensor::new(&stage, &lights);
        if let Some(pair) = input.representatives.pair[self.range.clone()].iter().find(|p| p[0] as usize >= tensor.lights()) {
            return Err(Error::invalid(format!("representative light {} of {}", pair[0], tensor.lights())));
        }
        let receivers = Receivers::of(&framebuffer);
        let served = self.served();
        let sums = self.sum_columns(&tensor, &receivers, &served)?;
        let pixels = framebuffer.triangle.len();
        let mut source = vec![Vec3::ZERO; pixels];
        let mut mapper = Mapper::new(input, self.ctx, self.source)?;
        let here = self.source.clamp(served.start, served.end);
        // Outward in both directions, so that each map is composed from the one before.
        for k in (here..served.end).chain((served.start..here).rev()) {
            source.fill(Vec3::ZERO);
            for (block, pixels) in sums.iter().zip(receivers.pixel.chunks(BLOCK)) {
                let sum = &block[(k - served.start) * 3 * pixels.len()..][..3 * pixels.len()];
                for (pixel, colour) in pixels.iter().zip(sum.as_chunks::<3>().0) {
                    source[*pixel as usize] = Vec3::from_array(*colour);
                }
            }
            mapper.add(k, &source, &mut images[k])?;
        }
        Ok(())
    }

    /// The frames that any representative of this pass serves.
    fn served(&self) -> Range<usize> {
        let frames = &self.input.representatives.frames[self.range.clone()];
        let start = frames.iter().map(|f| f[0]).min().unwrap_or(0);
        let end = frames.iter().map(|f| f[1]).max().unwrap_or(0);
        start as usize..end as usize
    }

    /// For each block of receivers, `[frame served][receiver][channel]`: the sum of all columns with
    /// their weights in that frame.
    fn sum_columns(&self, tensor: &RayTensor<'_>, receivers: &Receivers, served: &Range<usize>) -> Result<Vec<Vec<f32>>, Error> {
        let representatives = &self.input.representatives;
        let blocks = receivers.samples.len().div_ceil(BLOCK).max(1) as u64;
        let (before, finished) = (self.done.load(Ordering::Relaxed), AtomicU64::new(0));
        receivers
            .samples
            .par_chunks(BLOCK)
            .map(|block| {
                let mut sums = vec![0.0_f32; served.len() * 3 * block.len()];
                let mut column = [Vec3::ZERO; Ends::CAPACITY];
                for r in self.range.clone() {
                    let [light, _] = representatives.pair[r];
                    let [from, to] = representatives.frames[r];
                    let weights = &representatives.weight[representatives.first_weight[r] as usize..][..(to - from) as usize];
                    for (p, packet) in block.chunks(Ends::CAPACITY).enumerate() {
                        let column = &mut column[..packet.len()];
                        tensor.column(light as usize, packet, column);
                        if column.iter().all(|c| *c == Vec3::ZERO) {
                            continue;
                        }
                        for (k, weight) in (from as usize..).zip(weights) {
                            let at = ((k - served.start) * block.len() + p * Ends::CAPACITY) * 3;
                            add_scaled(&mut sums[at..at + 3 * packet.len()], column, *weight);
                        }
                    }
                }
                let finished = finished.fetch_add(1, Ordering::Relaxed) + 1;
                self.ctx.tick(before + self.range.len() as u64 * finished / blocks, self.total)?;
                Ok(sums)
            })
            .collect()
    }
}

/// `sum += weight * column`, per channel, as flat numbers: eight pixels are 24 of them, a whole
/// number of vectors of four and of eight.
fn add_scaled(sum: &mut [f32], column: &[Vec3], weight: Vec3) {
    let pattern: [f32; 24] = std::array::from_fn(|i| weight[i % 3]);
    let column: &[f32] = bytemuck::cast_slice(column);
    let (sums, sum_rest) = sum.as_chunks_mut::<24>();
    let (columns, column_rest) = column.as_chunks::<24>();
    for (sum, column) in sums.iter_mut().zip(columns) {
        (0..24).for_each(|i| sum[i] += pattern[i] * column[i]);
    }
    for (i, (sum, column)) in sum_rest.iter_mut().zip(column_rest).enumerate() {
        *sum += pattern[i] * column;
    }
}

/// Maps images of one frame to others, walking away from it one frame at a time.
struct Mapper<'a> {
    input: &'a ReconstructIn,
    ctx: &'a Ctx,
    source: usize,
    /// 9-vectors of the source frame; none where no map is needed.
    features: Option<Arc<Features>>,
    /// Frame reached, and its map into the source frame; none at the source itself.
    reached: (usize, Option<Vec<u32>>),
}

impl<'a> Mapper<'a> {
    fn new(input: &'a ReconstructIn, ctx: &'a Ctx, source: usize) -> Result<Self, Error> {
        let mut features = None;
        if let Some(maps) = &input.maps && !maps.is_empty() {
            features = Some(nine_vectors(ctx, &input.framebuffer.broadcast(source)?, &input.geometry, maps.get(0)?.weights)?);
        }
        Ok(Mapper { input, ctx, source, features, reached: (source, None) })
    }

    /// Adds `image` of the source frame to `target` of frame `k`: the source itself, or a frame
    /// farther out in the same direction as the last, or one on the other side of the source.
    fn add(&mut self, k: usize, image: &[Vec3], target: &mut [Vec3]) -> Result<(), Error> {
        if (k > self.source) != (self.reached.0 > self.source) {
            self.reached = (self.source, None);
        }
        while self.reached.0 != k {
            let next = if k > self.reached.0 { self.reached.0 + 1 } else { self.reached.0 - 1 };
            self.step(next)?;
        }
        match &self.reached.1 {
            None => target.par_iter_mut().zip(image).for_each(|(t, s)| *t += *s),
            Some(map) => target.par_iter_mut().zip(map).for_each(|(t, &p)| {
                if p != NONE {
                    *t += image[p as usize];
                }
            }),
        }
        Ok(())
    }

    fn step(&mut self, next: usize) -> Result<(), Error> {
        let at = self.reached.0;
        let (here, there) = (self.input.framebuffer.broadcast(at)?, self.input.framebuffer.broadcast(next)?);
        // Equal frames have equal maps into the source.
        if here.digest() == there.digest() {
            self.reached.0 = next;
            return Ok(());
        }
        let (Some(maps), Some(features)) = (&self.input.maps, &self.features) else {
            return Err(Error::invalid("representatives serve several frames: connect `maps` from PixelMaps"));
        };
        let pair = maps.broadcast(at.min(next))?;
        let step = if next > at { &pair.forward } else { &pair.backward };
        let map = match self.reached.1.take() {
            None => step.to_vec(),
            Some(onward) => {
                let target = nine_vectors(self.ctx, &there, &self.input.geometry, pair.weights)?;
                compose(&onward, step, features, &target).map_err(|e| Error::invalid(e.to_string()))?
            }
        };
        self.reached = (next, Some(map));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_sums_are_those_of_the_pixels() {
        let column: Vec<Vec3> = (0..11).map(|i| Vec3::new(i as f32, 1.0, -2.0 * i as f32)).collect();
        let weight = Vec3::new(2.0, 3.0, 0.5);
        let mut sum = vec![1.0; 33];
        add_scaled(&mut sum, &column, weight);
        for (i, colour) in sum.as_chunks::<3>().0.iter().enumerate() {
            assert_eq!(Vec3::from_array(*colour), Vec3::ONE + weight * column[i]);
        }
    }
}
