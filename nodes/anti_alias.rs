//! Anti-aliasing by a deep framebuffer of higher resolution (Hašan et al. 2008, section 5).

use crate::data::{Camera, DeepFramebuffer, Environment, Geometry, Image, Materials, Poses};
use crate::kernel::neighbours::{Features, nearest_of_3x3};
use crate::kernel::nine_vectors::{nine_vector, nine_vectors};
use crate::kernel::primary::{Lens, Seen, background};
use crate::kernel::receivers::TILE;
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node, Problems};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Looks at the scene in finer steps and gives each fine sample the colour of the pixel, of the 3 x 3
    /// around it, that is most like it; then averages. Shading is not computed again.
    pub struct AntiAlias {
        /// Samples across a pixel; odd, so that the middle one is the pixel's own. 3 in the paper.
        factor: u32 = 3, 1..=15;
        /// Weight of positions, which are counted in scene diagonals.
        position: f32 = 1.0, 0.0..=1000.0;
        /// Weight of unit normals.
        normal: f32 = 0.125, 0.0..=1000.0;
        /// Weight of diffuse reflectances.
        albedo: f32 = 0.125, 0.0..=1000.0;
    }
}

crate::inputs! {
    /// Inputs of [`AntiAlias`].
    pub struct AntiAliasIn {
        /// The picture, one sample a pixel.
        image: Item<Image>,
        /// What it shows.
        framebuffer: Item<DeepFramebuffer>,
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// The eye that took the picture.
        camera: Item<Camera>,
        /// Seen where no surface is.
        environment: Option<Item<Environment>>,
    }
}

impl Node for AntiAlias {
    const KIND: &'static str = "AntiAlias";
    const VERSION: u32 = 2;
    type In = AntiAliasIn;
    type Out = Image;

    fn check(&self, problems: &mut Problems) {
        if self.factor.is_multiple_of(2) {
            problems.report("factor", format!("expected an odd number, found {}", self.factor));
        }
    }

    fn run(&self, input: AntiAliasIn, ctx: &Ctx) -> Result<Image, Error> {
        let (width, height) = input.image.size();
        if input.framebuffer.size() != (width, height) {
            return Err(Error::invalid("the image and the framebuffer have different sizes"));
        }
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let weights = [self.position, self.normal, self.albedo];
        let features = nine_vectors(ctx, &input.framebuffer, &input.geometry, weights)?;
        let lens = Lens::new(&input.camera, width, height);
        let view = View { input: &input, stage: &stage, lens, features, weights };
        let (done, lost) = (AtomicU64::new(0), AtomicU64::new(0));
        let mut radiance = vec![Vec3::ZERO; width * height];
        radiance.par_chunks_mut(TILE * width.max(1)).enumerate().try_for_each(|(band, radiance)| {
            ctx.tick(done.fetch_add(TILE as u64, Ordering::Relaxed), height as u64)?;
            let mut fine = vec![Vec3::ZERO; (TILE * self.factor as usize).pow(2)];
            for left in (0..width).step_by(TILE) {
                let pixels = [left..(left + TILE).min(width), band * TILE..band * TILE + radiance.len() / width];
                self.look(&view, &pixels, &mut fine, &lost);
                self.average(&view, &pixels, &fine, &mut radiance[left..]);
            }
            Ok::<(), Error>(())
        })?;
        let lost = lost.into_inner();
        if lost > 0 {
            ctx.note(format!("{lost} samples see a surface that no pixel around them sees: only its emission is shown"));
        }
        Ok(Image::new(width, height, radiance))
    }
}

/// What a fine sample is looked up in.
struct View<'a> {
    input: &'a AntiAliasIn,
    stage: &'a Stage,
    lens: Lens<'a>,
    features: Arc<Features>,
    weights: [f32; 3],
}

/// Columns and rows of the pixels of a tile.
type Pixels = [Range<usize>; 2];

impl AntiAlias {
    /// Looks at the fine samples of some pixels, the pixels' own left out, a tile of them at once: their colours, row by
    /// row, into `fine`.
    fn look(&self, view: &View<'_>, pixels: &Pixels, fine: &mut [Vec3], lost: &AtomicU64) {
        let factor = self.factor as usize;
        let [across, down] = [0, 1].map(|axis| pixels[axis].len() * factor);
        let mut at = Vec::with_capacity(TILE * TILE);
        let mut place = Vec::with_capacity(TILE * TILE);
        for (top, left) in tiles(down).flat_map(|top| tiles(across).map(move |left| (top, left))) {
            at.clear();
            place.clear();
            for y in top..(top + TILE).min(down) {
                for x in left..(left + TILE).min(across) {
                    if (x % factor, y % factor) != (factor / 2, factor / 2) {
                        let offset = Vec2::new((x % factor) as f32 + 0.5, (y % factor) as f32 + 0.5) / factor as f32;
                        let pixel = [pixels[0].start + x / factor, pixels[1].start + y / factor];
                        at.push(Vec2::new(pixel[0] as f32, pixel[1] as f32) + offset);
                        place.push((y * across + x, pixel));
                    }
                }
            }
            view.lens.see_all(view.stage, &at, |i, seen| {
                let (at, pixel) = place[i];
                fine[at] = view.colour(pixel, seen, lost);
            });
        }
    }

    /// The mean of each pixel's samples, its own among them, into `radiance`, whose rows are those of the picture.
    fn average(&self, view: &View<'_>, pixels: &Pixels, fine: &[Vec3], radiance: &mut [Vec3]) {
        let (width, _) = view.input.image.size();
        let factor = self.factor as usize;
        let across = pixels[0].len() * factor;
        for (y, row) in pixels[1].clone().enumerate() {
            for (x, column) in pixels[0].clone().enumerate() {
                let mut sum = Vec3::ZERO;
                for sy in 0..factor {
                    for sx in 0..factor {
                        sum += if (sx, sy) == (factor / 2, factor / 2) {
                            view.input.image.radiance[row * width + column]
                        } else {
                            fine[(y * factor + sy) * across + x * factor + sx]
                        };
                    }
                }
                radiance[y * width + x] = sum / (factor * factor) as f32;
            }
        }
    }
}

/// Where tiles of a line of this length begin.
fn tiles(length: usize) -> impl Iterator<Item = usize> {
    (0..length).step_by(TILE)
}

impl View<'_> {
    /// The colour of a fine sample within `pixel`.
    fn colour(&self, [x, y]: [usize; 2], seen: Seen, lost: &AtomicU64) -> Vec3 {
        let (_, surface) = match seen {
            Ok(seen) => seen,
            Err(direction) => return self.input.environment.as_deref().map_or(Vec3::ZERO, |e| background(e, direction)),
        };
        let query = nine_vector(&surface, &self.input.geometry, self.weights);
        match nearest_of_3x3(&self.features, (x as u32, y as u32), &query) {
            Some(pixel) => self.input.image.radiance[pixel as usize],
            None => {
                lost.fetch_add(1, Ordering::Relaxed);
                surface.emitted
            }
        }
    }
}
