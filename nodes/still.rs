//! One frame of a shot.

use crate::data::Image;
use crate::node::{All, Ctx, Error, Node};

crate::params! {
    /// Takes one picture out of a sequence, to publish or to compare it by itself.
    pub struct Still {
        /// Its number, counted from 0 within the chunk.
        frame: u32 = 0;
    }
}

crate::inputs! {
    /// Inputs of [`Still`].
    pub struct StillIn {
        /// The sequence.
        images: All<Image>,
    }
}

impl Node for Still {
    const KIND: &'static str = "Still";
    const VERSION: u32 = 1;
    type In = StillIn;
    type Out = Image;

    fn memory(&self, inputs: &crate::node::Sizes) -> u64 {
        inputs.total() / inputs.items("images").max(1)
    }

    fn run(&self, input: StillIn, _: &Ctx) -> Result<Image, Error> {
        let frames = input.images.len();
        if self.frame as usize >= frames {
            return Err(Error::invalid(format!("frame {} of a sequence of {frames}: expected 0 to {}", self.frame, frames - 1)));
        }
        Ok((*input.images.get(self.frame as usize)?).clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Item;
    use glam::Vec3;

    #[test]
    fn takes_the_frame_or_says_which_there_are() {
        let images = || -> All<Image> {
            let image = |i: u32| Item::from(Image::new(1, 1, vec![Vec3::splat(i as f32)]));
            (0..3).map(image).collect::<Vec<_>>().into()
        };
        let take = |frame| Still { frame }.run(StillIn { images: images() }, &Ctx::default());
        assert_eq!(take(2).unwrap().radiance[0], Vec3::splat(2.0));
        assert!(take(3).unwrap_err().to_string().contains("0 to 2"));
    }
}
