//! Checkpoints of a long reconstruction: the images so far, so that an interrupted run goes on.

use crate::data::{Array, Arrays, Field, write_arrays};
use crate::node::{Ctx, Error};
use glam::Vec3;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time between two checkpoints at least: a checkpoint costs a write of all images.
const INTERVAL: Duration = Duration::from_secs(10);

/// The state of one reconstruction on disk, if its context has a place for it.
pub struct Checkpoint {
    path: Option<PathBuf>,
    next: u32,
    written: Instant,
}

impl Checkpoint {
    /// Reads the state an interrupted run left: `images` become those it had, and
    /// [`Checkpoint::next`] the step it had reached. A missing, damaged or foreign state is ignored.
    pub fn resume(ctx: &Ctx, images: &mut [Vec<Vec3>]) -> Self {
        let path = ctx.checkpoint().map(PathBuf::from);
        let next = path.as_ref().and_then(|path| read(path, images)).unwrap_or(0);
        if next > 0 {
            ctx.note(format!("went on from a checkpoint at step {next}"));
        }
        Checkpoint { path, next, written: Instant::now() }
    }

    /// The first step that is still to be done.
    pub fn next(&self) -> usize {
        self.next as usize
    }

    /// Keeps the state before step `next` if the last one is old enough.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub fn save(&mut self, next: usize, images: &[Vec<Vec3>]) -> Result<(), Error> {
        let Some(path) = &self.path else { return Ok(()) };
        if self.written.elapsed() < INTERVAL {
            return Ok(());
        }
        let part = path.with_extension("part");
        let written = write(&part, next as u32, images).and_then(|()| fs::rename(&part, path));
        self.written = Instant::now();
        written.map_err(|e| Error::file(path, format!("the checkpoint cannot be written: {e}")))
    }
}

fn write(path: &PathBuf, next: u32, images: &[Vec<Vec3>]) -> std::io::Result<()> {
    let flat: Array<Vec3> =
        Array::shaped(images.concat(), &[images.len(), images.first().map_or(0, Vec::len)]);
    let check = blake3::hash(bytemuck::cast_slice(&flat));
    let check: Array<u8> = check.as_bytes().to_vec().into();
    let mut out = BufWriter::new(fs::File::create(path)?);
    write_arrays(
        &mut out,
        &[("next", next.view()), ("images", flat.view()), ("check", check.view())],
    )?;
    out.flush()
}

fn read(path: &PathBuf, images: &mut [Vec<Vec3>]) -> Option<u32> {
    let arrays = Arrays::parse(Arc::new(fs::read(path).ok()?), "Checkpoint").ok()?;
    let flat = Array::<Vec3>::load(&arrays, "images").ok()?;
    let check = Array::<u8>::load(&arrays, "check").ok()?;
    let pixels = images.first().map_or(0, Vec::len);
    let sound = check[..] == blake3::hash(bytemuck::cast_slice(&flat)).as_bytes()[..];
    if flat.shape() != [images.len(), pixels] || pixels == 0 || !sound {
        return None;
    }
    images
        .iter_mut()
        .zip(flat.chunks_exact(pixels))
        .for_each(|(image, saved)| image.copy_from_slice(saved));
    u32::load(&arrays, "next").ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Derived;

    #[test]
    fn a_state_comes_back_and_a_damaged_one_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        let ctx = || {
            let derived = Arc::new(Derived::new(1));
            Ctx::new(Arc::default(), derived, Box::new(|_, _| {}), Some(path.clone()))
        };
        let saved = vec![vec![Vec3::X; 4], vec![Vec3::Y; 4]];
        write(&path, 7, &saved).unwrap();
        let mut images = vec![vec![Vec3::ZERO; 4]; 2];
        assert_eq!(Checkpoint::resume(&ctx(), &mut images).next(), 7);
        assert_eq!(images, saved);

        let mut bytes = fs::read(&path).unwrap();
        let last = bytes.len() - 40;
        bytes[last] ^= 1;
        fs::write(&path, bytes).unwrap();
        let mut images = vec![vec![Vec3::ZERO; 4]; 2];
        assert_eq!(Checkpoint::resume(&ctx(), &mut images).next(), 0);
        assert_eq!(images, vec![vec![Vec3::ZERO; 4]; 2]);
    }
}
