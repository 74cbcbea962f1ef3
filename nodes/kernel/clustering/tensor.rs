//! The reduced tensor R of sampled rows (Hašan 2008, sections 4.2 and 5).

use std::ops::Range;

use rayon::prelude::*;

use super::super::pages::Paged;
use super::{Error, lanes};

/// Entries looked at together when a frame is checked.
const CHECK: usize = 1024;
/// Lights copied by one task.
const LIGHTS: usize = 256;

/// The reduced tensor: the scalar contribution of every light to every sampled row in every frame, finite and >= 0, with the norm
/// of each column. Light-major, `[light][frame][row]`: the frames of a light are contiguous.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    lights: usize,
    rows: usize,
    frames: usize,
    data: Paged<f32>,
    norms: Vec<f64>,
}

impl Tensor {
    /// Fills the tensor frame by frame: `frame(k)` gives the rows of frame k as `[light][row]`, `lights * rows` values (the 2-norm
    /// of the RGB contribution), and is dropped before the next is asked for. Memory: the tensor, 8 bytes a light-frame
    /// pair, and the one frame.
    ///
    /// Fails on an extent of zero, on a size that cannot be addressed, on a frame of another size, and on the first entry
    /// that is negative or not finite.
    pub fn from_frames<D, E>(
        lights: usize,
        rows: usize,
        frames: usize,
        mut frame: impl FnMut(usize) -> Result<D, E>,
    ) -> Result<Tensor, E>
    where
        D: AsRef<[f32]>,
        E: From<Error>,
    {
        for (extent, name) in [(lights, "lights"), (rows, "rows"), (frames, "frames")] {
            if extent == 0 {
                return Err(Error::Empty(name).into());
            }
        }
        let too_large = Error::TooLarge { lights, rows, frames };
        let Some(pairs) = lights.checked_mul(frames).filter(|&pairs| u32::try_from(pairs).is_ok())
        else {
            return Err(too_large.into());
        };
        let Some(entries) = pairs.checked_mul(rows).filter(|&e| e <= isize::MAX as usize / 4)
        else {
            return Err(too_large.into());
        };
        let mut tensor =
            Tensor { lights, rows, frames, data: Paged::zeroed(entries), norms: vec![0.0; pairs] };
        for k in 0..frames {
            tensor.fill(k, frame(k)?.as_ref())?;
        }
        Ok(tensor)
    }

    fn fill(&mut self, frame: usize, values: &[f32]) -> Result<(), Error> {
        let (rows, frames) = (self.rows, self.frames);
        if values.len() != self.lights * rows {
            let (expected, found) = (self.lights * rows, values.len());
            return Err(Error::FrameSize { frame, expected, found });
        }
        if let Some(at) = first_invalid(values) {
            return Err(Error::Value {
                light: at / rows,
                row: at % rows,
                frame,
                value: values[at],
            });
        }
        self.data
            .par_chunks_mut(frames * rows)
            .zip(self.norms.par_chunks_mut(frames))
            .zip(values.par_chunks(rows))
            .with_min_len(LIGHTS)
            .for_each(|((slab, norms), column)| {
                slab[frame * rows..][..rows].copy_from_slice(column);
                norms[frame] = lanes::squares(column).sqrt();
            });
        Ok(())
    }

    /// Number of lights n.
    pub fn lights(&self) -> usize {
        self.lights
    }

    /// Number of sampled rows r in each frame.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of frames f.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The reduced column R(:, light, frame), `rows` values.
    pub fn column(&self, light: usize, frame: usize) -> &[f32] {
        &self.data[(light * self.frames + frame) * self.rows..][..self.rows]
    }

    /// The slab R(:, light, frames) unfolded: `[frame][row]`.
    pub fn slab(&self, light: usize, frames: Range<usize>) -> &[f32] {
        let start = (light * self.frames + frames.start) * self.rows;
        &self.data[start..][..frames.len() * self.rows]
    }

    /// The norms w of the reduced columns of a light in `frames`.
    pub fn norms(&self, light: usize, frames: Range<usize>) -> &[f64] {
        &self.norms[light * self.frames + frames.start..][..frames.len()]
    }
}

/// The position of the first entry that is negative, infinite or not a number.
fn first_invalid(values: &[f32]) -> Option<usize> {
    let valid = |v: &f32| *v >= 0.0 && *v <= f32::MAX;
    let chunk = values.chunks(CHECK).position(|c| !c.iter().fold(true, |all, v| all & valid(v)))?;
    let within = values[chunk * CHECK..].iter().position(|v| !valid(v))?;
    Some(chunk * CHECK + within)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames_of(values: &[Vec<f32>], lights: usize, rows: usize) -> Result<Tensor, Error> {
        Tensor::from_frames(lights, rows, values.len(), |k| Ok::<_, Error>(&values[k]))
    }

    #[test]
    fn frames_are_interleaved_by_light() {
        let tensor =
            frames_of(&[vec![3.0, 4.0, 0.0, 2.0], vec![5.0, 0.0, 7.0, 8.0]], 2, 2).unwrap();
        assert_eq!(tensor.slab(0, 0..2), [3.0, 4.0, 5.0, 0.0]);
        assert_eq!(tensor.column(1, 1), [7.0, 8.0]);
        assert_eq!(tensor.norms(0, 0..2), [5.0, 5.0]);
        assert_eq!(tensor.norms(1, 0..1), [2.0]);
    }

    #[test]
    fn invalid_entries_are_named() {
        for bad in [f32::NAN, f32::INFINITY, -1e-30] {
            let mut second = vec![1.0; 3000];
            second[2503] = bad;
            let error = frames_of(&[vec![1.0; 3000], second], 1000, 3).unwrap_err();
            let Error::Value { light: 834, row: 1, frame: 1, value } = error else {
                panic!("{error}")
            };
            assert_eq!(value.to_bits(), bad.to_bits());
        }
    }

    #[test]
    fn shapes_are_checked() {
        assert_eq!(frames_of(&[vec![]], 3, 0), Err(Error::Empty("rows")));
        let error = frames_of(&[vec![1.0; 5]], 3, 2).unwrap_err();
        assert_eq!(error, Error::FrameSize { frame: 0, expected: 6, found: 5 });
        let huge = Tensor::from_frames(1 << 40, 1 << 40, 1, |_| Ok::<Vec<f32>, Error>(vec![]));
        assert!(matches!(huge, Err(Error::TooLarge { .. })));
    }

    #[test]
    fn norms_do_not_overflow_or_vanish() {
        let tensor = frames_of(&[vec![f32::MAX; 4], vec![1e-45; 4]], 1, 4).unwrap();
        let norms = tensor.norms(0, 0..2);
        assert_eq!(norms[0], 2.0 * f64::from(f32::MAX));
        assert_eq!(norms[1], 2.0 * f64::from(1e-45f32));
    }
}
