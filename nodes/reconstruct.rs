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
use std::collections::BTreeMap;
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
    // The columns of a small count are among those of a larger one, where representatives nest.
    const SHARES: Option<&'static str> = Some("representatives");

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A pixel takes 80 bytes in a framebuffer and 12 in each of the two images of a frame.
        inputs.bytes("framebuffer") / 80 * 24 + 8 * inputs.bytes("geometry")
    }

    fn run(&self, input: ReconstructIn, ctx: &Ctx) -> Result<Sequence<Image>, Error> {
        let mut outputs = self.run_together(vec![(input, ctx)])?;
        outputs.pop().ok_or_else(|| Error::invalid("a pass gave nothing"))
    }

    fn run_together(&self, runs: Vec<(ReconstructIn, &Ctx)>) -> Result<Vec<Sequence<Image>>, Error> {
        let mut shots = Vec::with_capacity(runs.len());
        for (input, ctx) in &runs {
            shots.push(Shot::begin(input, ctx)?);
        }
        let Some((input, _)) = runs.first() else { return Ok(Vec::new()) };
        let frames = shots.iter().map(|shot| shot.images.len()).max().unwrap_or(0);
        for source in 0..frames {
            Pass::new(input, &shots, source).run(&mut shots)?;
        }
        let shape = input.framebuffer.get(0)?.triangle.shape().to_vec();
        let image = |radiance| Image { radiance: Array::shaped(radiance, &shape) };
        let sequence = |shot: Shot<'_>| Sequence {
            chunk: shot.images.len(),
            items: shot.images.into_iter().map(image).collect(),
        };
        Ok(shots.into_iter().map(sequence).collect())
    }
}

/// One reconstruction under way: what it renders, and its images so far.
struct Shot<'a> {
    representatives: &'a Representatives,
    ctx: &'a Ctx,
    checkpoint: Checkpoint,
    images: Vec<Vec<Vec3>>,
}

impl<'a> Shot<'a> {
    /// Starts with what the framebuffers have, or where an interrupted run left off.
    fn begin(input: &'a ReconstructIn, ctx: &'a Ctx) -> Result<Self, Error> {
        let representatives = &*input.representatives;
        let frames = representatives.count as usize;
        // One framebuffer serves a shot in which only lights change.
        let found = input.framebuffer.len();
        if found != frames && found != 1 {
            return Err(Error::invalid(format!("representatives of {frames} frames, framebuffers of {found}")));
        }
        let first = input.framebuffer.get(0)?;
        let mut images = Vec::with_capacity(frames);
        for k in 0..frames {
            let framebuffer = input.framebuffer.broadcast(k)?;
            if framebuffer.triangle.shape() != first.triangle.shape() {
                return Err(Error::invalid("the framebuffers of the shot have different sizes"));
            }
            images.push(framebuffer.emitted.to_vec());
            let columns = served_from(representatives, k).len();
            let receivers = framebuffer.triangle.iter().filter(|&&t| t != NONE).count();
            ctx.evaluated(columns as u64 * receivers as u64);
        }
        let checkpoint = Checkpoint::resume(ctx, &mut images);
        Ok(Shot { representatives, ctx, checkpoint, images })
    }

    /// Its representatives in frame `source`; none where a checkpoint has them already.
    fn columns(&self, source: usize) -> Range<usize> {
        let range = served_from(self.representatives, source);
        if source < self.checkpoint.next() { range.end..range.end } else { range }
    }
}

/// The representatives whose column lies in frame `source`; they are sorted by frame.
fn served_from(representatives: &Representatives, source: usize) -> Range<usize> {
    let pair = &representatives.pair;
    pair.partition_point(|p| (p[1] as usize) < source)..pair.partition_point(|p| p[1] as usize <= source)
}

/// All representatives that any of the reconstructions has in one frame. Each column is rendered once,
/// however many of them use it.
struct Pass<'a> {
    input: &'a ReconstructIn,
    source: usize,
    /// Each light with who uses its column: reconstruction and number among its representatives.
    columns: Vec<(u32, Vec<(usize, usize)>)>,
    members: Vec<Member<'a>>,
}

/// One reconstruction's part of a pass.
struct Member<'a> {
    representatives: &'a Representatives,
    ctx: &'a Ctx,
    /// Frames that any of its representatives in this pass serves.
    served: Range<usize>,
    /// Its representatives up to this pass.
    before: u64,
}

impl<'a> Pass<'a> {
    fn new(input: &'a ReconstructIn, shots: &[Shot<'a>], source: usize) -> Self {
        let mut columns: BTreeMap<u32, Vec<(usize, usize)>> = BTreeMap::new();
        let mut members = Vec::with_capacity(shots.len());
        for (m, shot) in shots.iter().enumerate() {
            let range = shot.columns(source);
            range.clone().for_each(|r| columns.entry(shot.representatives.pair[r][0]).or_default().push((m, r)));
            let frames = &shot.representatives.frames[range.clone()];
            let start = frames.iter().map(|f| f[0]).min().unwrap_or(0) as usize;
            let end = frames.iter().map(|f| f[1]).max().unwrap_or(0) as usize;
            members.push(Member {
                representatives: shot.representatives,
                ctx: shot.ctx,
                served: start..end,
                before: range.start as u64,
            });
        }
        Pass { input, source, columns: columns.into_iter().collect(), members }
    }

    fn run(&self, shots: &mut [Shot<'_>]) -> Result<(), Error> {
        let (Some((last, _)), Some(first)) = (self.columns.last(), self.members.first()) else { return Ok(()) };
        let input = self.input;
        let framebuffer = input.framebuffer.broadcast(self.source)?;
        let poses = input.poses.broadcast(self.source)?;
        let lights = input.lights.broadcast(self.source)?;
        let stage = Stage::of(first.ctx, &input.geometry, &input.materials, &poses)?;
        let tensor = RayTensor::new(&stage, &lights);
        if *last as usize >= tensor.lights() {
            return Err(Error::invalid(format!("representative light {last} of {}", tensor.lights())));
        }
        let receivers = Receivers::of(&framebuffer);
        for member in &self.members {
            member.ctx.pass_evaluated(self.columns.len() as u64 * receivers.samples.len() as u64);
        }
        // The sums of a block for all members together fit the cache as those of one do.
        let block = (BLOCK / self.members.len()).next_multiple_of(Ends::CAPACITY);
        let sums = self.sum_columns(&tensor, &receivers, block)?;
        let mut source = vec![Vec3::ZERO; framebuffer.triangle.len()];
        let mut mapper = Mapper::new(input, first.ctx, self.source)?;
        let active = || self.members.iter().map(|m| m.served.clone()).filter(|served| !served.is_empty());
        let start = active().map(|served| served.start).min().unwrap_or(0);
        let end = active().map(|served| served.end).max().unwrap_or(0);
        let here = self.source.clamp(start, end);
        // Outward in both directions, so that each map is composed from the one before.
        for k in (here..end).chain((start..here).rev()) {
            for (m, member) in self.members.iter().enumerate().filter(|(_, member)| member.served.contains(&k)) {
                source.fill(Vec3::ZERO);
                for (sums, pixels) in sums.iter().zip(receivers.pixel.chunks(block)) {
                    let sum = &sums[m][(k - member.served.start) * 3 * pixels.len()..][..3 * pixels.len()];
                    for (pixel, colour) in pixels.iter().zip(sum.as_chunks::<3>().0) {
                        source[*pixel as usize] = Vec3::from_array(*colour);
                    }
                }
                mapper.add(k, &source, &mut shots[m].images[k])?;
            }
        }
        for shot in shots {
            let range = shot.columns(self.source);
            if !range.is_empty() {
                shot.checkpoint.save(self.source + 1, &shot.images)?;
                shot.ctx.tick(range.end as u64, shot.representatives.pair.len() as u64)?;
            }
        }
        Ok(())
    }

    /// For each block of receivers and each member, `[frame served][receiver][channel]`: the sum of its
    /// columns with their weights in that frame.
    fn sum_columns(&self, tensor: &RayTensor<'_>, receivers: &Receivers, block: usize) -> Result<Vec<Vec<Vec<f32>>>, Error> {
        let (blocks, finished) = (receivers.samples.len().div_ceil(block).max(1) as u64, AtomicU64::new(0));
        receivers
            .samples
            .par_chunks(block)
            .map(|block| {
                let zeros = |member: &Member<'_>| vec![0.0_f32; member.served.len() * 3 * block.len()];
                let mut sums: Vec<Vec<f32>> = self.members.iter().map(zeros).collect();
                let mut column = [Vec3::ZERO; Ends::CAPACITY];
                for (light, users) in &self.columns {
                    for (p, packet) in block.chunks(Ends::CAPACITY).enumerate() {
                        let column = &mut column[..packet.len()];
                        tensor.column(*light as usize, packet, column);
                        if column.iter().all(|c| *c == Vec3::ZERO) {
                            continue;
                        }
                        for &(m, r) in users {
                            self.members[m].add(r, block.len(), p * Ends::CAPACITY, column, &mut sums[m]);
                        }
                    }
                }
                let finished = finished.fetch_add(1, Ordering::Relaxed) + 1;
                for member in self.members.iter().filter(|m| !m.served.is_empty()) {
                    let columns = served_from(member.representatives, self.source).len() as u64;
                    let total = member.representatives.pair.len() as u64;
                    member.ctx.tick(member.before + columns * finished / blocks, total)?;
                }
                Ok(sums)
            })
            .collect()
    }
}

impl Member<'_> {
    /// Adds the column of representative `r` on the receivers from `at` on to the sums of a block of
    /// `block` receivers, with its weight in every frame it serves.
    fn add(&self, r: usize, block: usize, at: usize, column: &[Vec3], sums: &mut [f32]) {
        let representatives = self.representatives;
        let [from, to] = representatives.frames[r].map(|f| f as usize);
        let weights = &representatives.weight[representatives.first_weight[r] as usize..][..to - from];
        for (k, weight) in (from..).zip(weights) {
            let start = ((k - self.served.start) * block + at) * 3;
            add_scaled(&mut sums[start..start + 3 * column.len()], column, *weight);
        }
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
