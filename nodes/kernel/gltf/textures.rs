//! Images, as texels of eight bits a channel.

use super::buffers::{Buffers, Uri};
use super::container::Document;
use super::notes::Notes;
use crate::node::Error;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;

/// Widest and highest image.
const LARGEST: u32 = 16_384;
/// Bytes that decoding one image may take: two copies of the largest one with 16 bits a channel.
const DECODING: u64 = 4 << 30;
/// Texels of all images together.
const TEXELS: usize = 1 << 30;

/// The images that materials use, each decoded once.
pub(super) struct Textures<'a> {
    document: &'a Document,
    buffers: &'a Buffers,
    folder: &'a Path,
    notes: &'a Notes,
    /// For each image of the file: not asked for yet, or its row here, or -1 when it is unusable.
    rows: Vec<Option<f32>>,
    pub(super) texture: Vec<[u32; 3]>,
    pub(super) texel: Vec<[u8; 4]>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(
        document: &'a Document,
        buffers: &'a Buffers,
        folder: &'a Path,
        notes: &'a Notes,
    ) -> Self {
        let rows = vec![None; document.images.len()];
        Textures { document, buffers, folder, notes, rows, texture: Vec::new(), texel: Vec::new() }
    }

    /// The row of the file's texture `index`; -1 with a note when its image is missing or unusable.
    pub(super) fn row(&mut self, index: usize) -> Result<f32, Error> {
        let wrong = |what: &str| Error::invalid(format!("textures[{index}] {what}"));
        let texture = self.document.textures.get(index).ok_or_else(|| wrong("does not exist"))?;
        let place = format!("textures[{index}]");
        if let Some(sampler) = texture.sampler {
            let sampler = self
                .document
                .samplers
                .get(sampler)
                .ok_or_else(|| wrong("has a sampler that does not exist"))?;
            let repeats = Checked::Valid(WrappingMode::Repeat);
            if sampler.wrap_s != repeats || sampler.wrap_t != repeats {
                self.notes.count("uses of textures that do not repeat: they repeat here", &place);
            }
        }
        let Some(source) = texture.source else {
            self.notes.count("textures without an image of a kind that is read: left out", &place);
            return Ok(-1.0);
        };
        match self.rows.get(source) {
            None => return Err(wrong("has an image that does not exist")),
            Some(Some(row)) => return Ok(*row),
            Some(None) => {}
        }
        let row = match self.decode(source) {
            Ok(image) => self.append(&image)?,
            Err(what) => {
                self.notes.count(
                    "images missing or unreadable: their textures are left out",
                    &what.to_string(),
                );
                -1.0
            }
        };
        self.rows[source] = Some(row);
        Ok(row)
    }

    fn append(&mut self, image: &image::RgbaImage) -> Result<f32, Error> {
        let texels = image.len() / 4;
        let refused = || {
            Error::invalid(format!(
                "the images have more than {TEXELS} texels, or more than memory holds"
            ))
        };
        if texels > TEXELS - self.texel.len() {
            return Err(refused());
        }
        self.texel.try_reserve(texels).map_err(|_| refused())?;
        let row = self.texture.len() as f32;
        self.texture.push([self.texel.len() as u32, image.width(), image.height()]);
        self.texel.extend(image.pixels().map(|p| p.0));
        Ok(row)
    }

    fn decode(&self, index: usize) -> Result<image::RgbaImage, Error> {
        let image = &self.document.images[index];
        let named = |e: &dyn std::fmt::Display| Error::invalid(format!("images[{index}]: {e}"));
        let owned;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                owned = Uri::new(uri, self.folder).read().map_err(|e| named(&e))?;
                &owned[..]
            }
            (None, Some(view)) => {
                self.buffers.view(self.document, view.value()).map_err(|e| named(&e))?.bytes
            }
            (None, None) => return Err(named(&"neither a URI nor a buffer view")),
        };
        let mut reader =
            ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| named(&e))?;
        if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg)) {
            return Err(named(&"neither PNG nor JPEG"));
        }
        let mut limits = Limits::default();
        limits.max_image_width = Some(LARGEST);
        limits.max_image_height = Some(LARGEST);
        limits.max_alloc = Some(DECODING);
        reader.limits(limits);
        Ok(reader.decode().map_err(|e| named(&e))?.into_rgba8())
    }
}
