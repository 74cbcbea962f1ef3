//! An environment from an image file: OpenEXR or Radiance HDR.

use crate::data::{Array, Environment};
use crate::kernel::radiance_file::{RadianceFile, announced};
use crate::node::{Ctx, Error, File, Node, Sizes};
use glam::Vec3;

crate::params! {
    /// A latitude-longitude map from an .exr or .hdr file (told apart by content), linear Rec. 709.
    /// Components that are negative or not a number become 0, infinite ones the largest finite one; a
    /// note counts them. A file without colours gives grey.
    pub struct EnvironmentMap {
        /// The image; its middle column is +X, its top row +Y.
        file: File;
        /// Turn about the vertical axis, degrees; 90 brings +X to -Z.
        rotation: f32 = 0.0;
        /// Factor on all radiances.
        scale: f32 = 1.0, 0.0..=1e9;
    }
}

/// Radiances above this count as infinite, so that their sums and squares stay finite in f64.
const BRIGHTEST: f32 = 1e30;

impl Node for EnvironmentMap {
    const KIND: &'static str = "EnvironmentMap";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Environment;

    fn memory(&self, _: &Sizes) -> u64 {
        // The samples as decoded and the texels; a file that cannot be read takes nothing.
        announced(&self.file.0).map_or(0, |n| 16 * n)
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<Environment, Error> {
        ctx.tick(0, 1)?;
        let mut map = RadianceFile::read(&self.file.0)?;
        let repaired = sanitise(&mut map.texels);
        if repaired > 0 {
            ctx.note(format!(
                "{repaired} negative or non-finite components of an environment map were clamped"
            ));
        }
        for row in map.texels.chunks_exact_mut(map.width) {
            turn(row, self.rotation);
            row.iter_mut().for_each(|l| *l = (*l * self.scale).min(Vec3::splat(BRIGHTEST)));
        }
        let (width, height) = (map.width, map.height());
        Ok(Environment { radiance: Array::shaped(map.texels, &[height, width]) })
    }
}

/// Makes every component finite and not negative; returns how many it changed.
fn sanitise(texels: &mut [Vec3]) -> u64 {
    let components = || texels.iter().flat_map(|l| l.to_array());
    let largest = components().filter(|x| *x <= BRIGHTEST).fold(0.0, f32::max);
    let mut changed = 0;
    for texel in texels {
        let clean = texel.to_array().map(|x| if x.is_nan() { 0.0 } else { x.clamp(0.0, largest) });
        changed +=
            texel.to_array().iter().zip(clean).filter(|(was, is)| **was != *is).count() as u64;
        *texel = clean.into();
    }
    changed
}

/// Turns one row of texels; fractions of a texel are interpolated, which keeps the row's sum.
fn turn(row: &mut [Vec3], degrees: f32) {
    let width = row.len();
    let shift = (f64::from(degrees) / 360.0).rem_euclid(1.0) * width as f64;
    let (whole, part) = ((shift as usize) % width, shift.fract() as f32);
    row.rotate_left(whole);
    if part > 0.0 {
        let first = row[0];
        for i in 0..width {
            let next = if i + 1 < width { row[i + 1] } else { first };
            row[i] = row[i] * (1.0 - part) + next * part;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::latlong;
    use exr::prelude::{SpecificChannels, WritableImage};
    use std::path::{Path, PathBuf};

    fn load(file: PathBuf, rotation: f32) -> Result<(Environment, Vec<String>), Error> {
        let ctx = Ctx::default();
        let environment =
            EnvironmentMap { file: File(file), rotation, scale: 2.0 }.run((), &ctx)?;
        Ok((environment, ctx.notes()))
    }

    fn write_exr(
        path: &Path,
        width: usize,
        height: usize,
        at: impl Fn(usize, usize) -> [f32; 3] + Sync,
    ) {
        let channels = SpecificChannels::rgb(|p: exr::math::Vec2<usize>| {
            let [r, g, b] = at(p.x(), p.y());
            (r, g, b)
        });
        exr::prelude::Image::from_channels((width, height), channels)
            .write()
            .to_file(path)
            .unwrap();
    }

    #[test]
    fn exr_and_hdr_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let (exr, hdr) = (folder.path().join("a.exr"), folder.path().join("b.bin"));
        let at = |x: usize, y: usize| [x as f32, y as f32 * 0.5, 1.0];
        write_exr(&exr, 4, 2, at);
        let pixels: Vec<_> = (0..8).map(|i| image::Rgb(at(i % 4, i / 4))).collect();
        let file = std::fs::File::create(&hdr).unwrap();
        image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 4, 2).unwrap();
        for path in [exr, hdr] {
            let (environment, notes) = load(path.clone(), 0.0).unwrap();
            assert_eq!(environment.radiance.shape(), [2, 4]);
            for (i, l) in environment.radiance.iter().enumerate() {
                let want = Vec3::from_array(at(i % 4, i / 4)) * 2.0;
                assert!(l.abs_diff_eq(want, 0.03), "{}: {l} {want}", path.display());
            }
            assert!(notes.is_empty());
        }
    }

    #[test]
    fn a_quarter_turn_brings_x_to_minus_z() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, 8, 4, |x, y| if (x, y) == (4, 2) { [8.0; 3] } else { [0.0; 3] });
        let brightest = |rotation| {
            let (environment, _) = load(path.clone(), rotation).unwrap();
            let mean: Vec3 = (0..32)
                .map(|i| {
                    latlong::direction((i % 8) as f64 / 8.0, 0.5).as_vec3()
                        * environment.radiance[i].x
                })
                .sum();
            (mean.normalize(), environment.radiance.iter().map(|l| l.x).sum::<f32>())
        };
        for (rotation, towards) in
            [(0.0, Vec3::X), (90.0, Vec3::NEG_Z), (-90.0, Vec3::Z), (450.0, Vec3::NEG_Z)]
        {
            let (mean, sum) = brightest(rotation);
            assert!(
                mean.abs_diff_eq(towards, 1e-5) && (sum - 16.0).abs() < 1e-4,
                "{rotation}: {mean} {sum}"
            );
        }
        let (mean, sum) = brightest(22.5);
        assert!((sum - 16.0).abs() < 1e-4 && mean.z < -0.3 && mean.x > 0.8, "{mean} {sum}");
    }

    #[test]
    fn impossible_texels_are_clamped_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let bad = [f32::NAN, -1.0, f32::INFINITY, 5.0];
        write_exr(&path, 4, 1, |x, _| [bad[x], 1.0, 0.0]);
        let (environment, notes) = load(path.clone(), 0.0).unwrap();
        let red: Vec<f32> = environment.radiance.iter().map(|l| l.x).collect();
        assert_eq!(red, [0.0, 0.0, 10.0, 10.0]);
        assert!(notes.len() == 1 && notes[0].starts_with("3 "), "{notes:?}");
        for value in [0.0, f32::NAN, f32::INFINITY, 3e38] {
            write_exr(&path, 1, 1, |_, _| [value; 3]);
            assert_eq!(load(path.clone(), 33.0).unwrap().0.radiance[..], [Vec3::ZERO]);
        }
    }

    #[test]
    fn broken_files_are_errors_that_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, 64, 64, |x, y| [x as f32, y as f32, (x * y) as f32]);
        let whole = std::fs::read(&path).unwrap();
        let mut huge =
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2000000000 +X 2000000000\n".to_vec();
        huge.extend([2, 2, 0, 0]);
        let contents =
            [&whole[..whole.len() / 2], &whole[..40], b"", b"P6 1 1 255", &huge, b"#?RADIANCE\n"];
        for bytes in contents {
            std::fs::write(&path, bytes).unwrap();
            let error = load(path.clone(), 0.0).unwrap_err().to_string();
            assert!(error.contains("a.exr"), "{error}");
        }
        assert!(load(folder.path().join("none.hdr"), 0.0).is_err());
    }

    #[test]
    fn the_corpus_gives_clean_maps_or_errors() {
        let shared = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/scenes"));
        let mut folders = vec![shared.join("openexr_images"), shared.join("hdri")];
        let (mut read, mut refused) = (0, 0);
        while let Some(folder) = folders.pop() {
            let Ok(entries) = std::fs::read_dir(&folder) else {
                eprintln!("skipped: {} is absent", folder.display());
                continue;
            };
            for path in entries.flatten().map(|e| e.path()) {
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                match load(path.clone(), 10.0) {
                    Ok((environment, _)) => {
                        let clean = |l: &Vec3| l.is_finite() && l.min_element() >= 0.0;
                        assert!(environment.radiance.iter().all(clean), "{}", path.display());
                        read += 1;
                    }
                    Err(error) => {
                        assert!(matches!(error, Error::File { .. }), "{}: {error}", path.display());
                        refused += 1;
                    }
                }
            }
        }
        eprintln!("{read} read, {refused} refused");
    }
}
