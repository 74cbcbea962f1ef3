//! Rows of the lighting tensor at a few pixels: the exploration (Hašan et al. 2008, section 5).

use crate::data::{self, Array, DeepFramebuffer, Geometry, Lights, Materials, NONE, Poses};
use crate::kernel::element::Receiver;
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node, Problems, Sizes};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Samples rows of the lighting tensor: every light's contribution at one pixel in each bin of the
    /// picture.
    pub struct Rows {
        /// Bins across and down; each gives one row, at its centre or, where the centre sees no
        /// surface, at the nearest pixel of the bin that does. A bin that sees none has a dark row.
        /// Together at most 65,536.
        bins: [u32; 2] = [10, 10];
    }
}

crate::inputs! {
    /// Inputs of [`Rows`].
    pub struct RowsIn {
        /// Surface samples.
        framebuffer: Item<DeepFramebuffer>,
        /// All lights.
        lights: Item<Lights>,
        /// Shapes that cast shadows.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
    }
}

impl Node for Rows {
    const KIND: &'static str = "Rows";
    const VERSION: u32 = 1;
    type In = RowsIn;
    type Out = data::Rows;

    fn check(&self, problems: &mut Problems) {
        let count = u64::from(self.bins[0]) * u64::from(self.bins[1]);
        if !(1..=65_536).contains(&count) {
            problems.report("bins", format!("expected 1 to 65536 bins in all, found {count}"));
        }
    }

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A light takes 53 bytes in its artifact.
        let lights = inputs.bytes("lights") / 53;
        16 * lights * u64::from(self.bins[0]) * u64::from(self.bins[1])
    }

    fn run(&self, input: RowsIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        if input.lights.kind.is_empty() {
            return Err(Error::invalid("there is no light to sample: connect lights that have at least one"));
        }
        let pixel = self.pixels(&input.framebuffer);
        if pixel.iter().all(|&p| p == NONE) {
            return Err(Error::invalid("no shading samples: the camera sees no surface in any bin"));
        }
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let tensor = RayTensor::new(&stage, &input.lights);
        let sampled = pixel.iter().filter(|&&p| p != NONE).count();
        ctx.evaluated(sampled as u64 * tensor.lights() as u64);
        let done = AtomicU64::new(0);
        let rows: Vec<Vec<Vec3>> = pixel
            .par_iter()
            .map(|&p| {
                ctx.tick(done.fetch_add(1, Ordering::Relaxed), pixel.len() as u64)?;
                let mut row = vec![Vec3::ZERO; tensor.lights()];
                if p != NONE && let Some(receiver) = Receiver::at(&input.framebuffer, p as usize) {
                    tensor.row(&receiver, &mut row);
                }
                Ok(row)
            })
            .collect::<Result<_, Error>>()?;
        let (reduced, norm) = reduce(&rows, tensor.lights());
        Ok(data::Rows { reduced, norm, pixel: pixel.into(), identity: input.lights.identity })
    }
}

impl Rows {
    /// The pixel of each bin; [`NONE`] for a bin that sees no surface.
    fn pixels(&self, framebuffer: &DeepFramebuffer) -> Vec<u32> {
        let (width, height) = framebuffer.size();
        let [across, down] = self.bins.map(|b| b as usize);
        let edge = |i: usize, bins: usize, pixels: usize| i * pixels / bins;
        let mut pixels = Vec::new();
        for by in 0..down {
            for bx in 0..across {
                let (x0, x1) = (edge(bx, across, width), edge(bx + 1, across, width));
                let (y0, y1) = (edge(by, down, height), edge(by + 1, down, height));
                let (cx, cy) = ((x0 + x1) / 2, (y0 + y1) / 2);
                let inside = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
                let nearest = inside
                    .filter(|&(x, y)| framebuffer.triangle[y * width + x] != NONE)
                    .min_by_key(|&(x, y)| (x.abs_diff(cx).pow(2) + y.abs_diff(cy).pow(2), y, x));
                pixels.push(nearest.map_or(NONE, |(x, y)| (y * width + x) as u32));
            }
        }
        pixels
    }
}

/// The 2-norms of the RGB elements as `[light, row]`, and each light's per-channel column norms.
fn reduce(rows: &[Vec<Vec3>], lights: usize) -> (Array<f32>, Array<Vec3>) {
    let (reduced, norm): (Vec<Vec<f32>>, Vec<Vec3>) = (0..lights)
        .into_par_iter()
        .map(|j| {
            let squares: DVec3 = rows.iter().map(|row| row[j].as_dvec3() * row[j].as_dvec3()).sum();
            let length = |v: Vec3| v.as_dvec3().length().min(f64::from(f32::MAX)) as f32;
            let root = DVec3::new(squares.x.sqrt(), squares.y.sqrt(), squares.z.sqrt());
            (rows.iter().map(|row| length(row[j])).collect(), root.min(DVec3::splat(f64::from(f32::MAX))).as_vec3())
        })
        .unzip();
    (Array::shaped(reduced.concat(), &[lights, rows.len()]), norm.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_sit_at_bin_centres_or_the_nearest_surface() {
        let mut triangle = vec![0_u32; 20 * 20];
        triangle[5 * 20 + 5] = NONE;
        (0..400).filter(|p| p % 20 >= 10 && p / 20 >= 10).for_each(|p| triangle[p] = NONE);
        let vectors = || Array::shaped(vec![Vec3::Y; 400], &[20, 20]);
        let framebuffer = DeepFramebuffer {
            position: vectors(),
            normal: vectors(),
            facet: vectors(),
            albedo: vectors(),
            specular: vectors(),
            roughness: Array::shaped(vec![1.0; 400], &[20, 20]),
            emitted: vectors(),
            triangle: Array::shaped(triangle, &[20, 20]),
            eye: Vec3::ZERO,
            perspective: 1,
            forward: Vec3::Z,
        };
        let rows = Rows { bins: [2, 2] };
        assert_eq!(rows.pixels(&framebuffer), [4 * 20 + 5, 5 * 20 + 15, 15 * 20 + 5, NONE]);
        let all = Rows { bins: [20, 20] }.pixels(&framebuffer);
        assert_eq!((all.len(), all.iter().filter(|p| **p == NONE).count()), (400, 101));
    }

    #[test]
    fn norms_of_rows_are_those_of_the_colours() {
        let rows = vec![vec![Vec3::new(3.0, 4.0, 0.0), Vec3::ZERO], vec![Vec3::new(4.0, 0.0, 0.0), Vec3::ZERO]];
        let (reduced, norm) = reduce(&rows, 2);
        assert_eq!(&reduced[..], [5.0, 4.0, 0.0, 0.0]);
        assert_eq!(&norm[..], [Vec3::new(5.0, 4.0, 0.0), Vec3::ZERO]);
    }
}
