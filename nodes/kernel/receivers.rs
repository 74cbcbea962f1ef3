//! The surface samples of a frame, in an order in which neighbours are close: tiles of 8 x 8 pixels.

use super::element::Receiver;
use crate::data::{DeepFramebuffer, NONE};

/// Side of a tile in pixels; a tile fills one packet of rays.
pub const TILE: usize = 8;

/// All pixels of a deep framebuffer that see a surface.
pub struct Receivers {
    /// The samples, tile after tile.
    pub samples: Vec<Receiver>,
    /// The pixel of each sample.
    pub pixel: Vec<u32>,
}

impl Receivers {
    /// The receivers of a framebuffer; pixels that see no surface are left out.
    pub fn of(framebuffer: &DeepFramebuffer) -> Self {
        let (width, height) = framebuffer.size();
        let mut receivers = Receivers { samples: Vec::new(), pixel: Vec::new() };
        for ty in (0..height).step_by(TILE) {
            for tx in (0..width).step_by(TILE) {
                for y in ty..(ty + TILE).min(height) {
                    for x in tx..(tx + TILE).min(width) {
                        let pixel = y * width + x;
                        if let Some(receiver) = Receiver::at(framebuffer, pixel) {
                            receivers.samples.push(receiver);
                            receivers.pixel.push(pixel as u32);
                        }
                    }
                }
            }
        }
        receivers
    }

    /// For each of a frame's `pixels` pixels the number of its sample, or [`NONE`].
    pub fn places(&self, pixels: usize) -> Vec<u32> {
        let mut places = vec![NONE; pixels];
        self.pixel.iter().zip(0..).for_each(|(pixel, place)| places[*pixel as usize] = place);
        places
    }
}
