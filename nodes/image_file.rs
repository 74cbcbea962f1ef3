//! An image from a file, to be compared with one of ours.

use crate::data::Image;
use crate::kernel::radiance_file::{RadianceFile, announced};
use crate::node::{Ctx, Error, File, Node, Sizes};

crate::params! {
    /// Radiance from an .exr or .hdr file (told apart by content), linear Rec. 709, as it stands there.
    /// Of an OpenEXR file, the first layer with red, green and blue; a file without colours gives grey.
    pub struct ImageFile {
        /// The file.
        file: File;
    }
}

impl Node for ImageFile {
    const KIND: &'static str = "ImageFile";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Image;

    fn memory(&self, _: &Sizes) -> u64 {
        // The samples as decoded and the pixels; a file that cannot be read takes nothing.
        announced(&self.file.0).map_or(0, |n| 16 * n)
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<Image, Error> {
        ctx.tick(0, 1)?;
        let file = RadianceFile::read(&self.file.0)?;
        let (width, height) = (file.width, file.height());
        Ok(Image::new(width, height, file.texels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::write_rgb_file;

    #[test]
    fn a_file_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.exr");
        write_rgb_file(&path, 3, 2, |x, y| (x as f32, -(y as f32), 1e30_f32)).unwrap();
        let image = ImageFile { file: File(path) }.run((), &Ctx::default()).unwrap();
        assert_eq!(image.size(), (3, 2));
        assert_eq!(image.radiance[5].to_array(), [2.0, -1.0, 1e30]);
    }

    #[test]
    fn what_is_no_image_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.exr");
        std::fs::write(&path, "no image at all").unwrap();
        let error = ImageFile { file: File(path) }.run((), &Ctx::default()).err().unwrap();
        assert!(error.to_string().contains("x.exr: expected an OpenEXR or a Radiance HDR image"));
    }
}
