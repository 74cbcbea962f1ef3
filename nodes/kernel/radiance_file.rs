//! Pictures of radiance in files: OpenEXR and Radiance HDR, told apart by content.

use crate::node::Error;
use exr::meta::MetaData;
use exr::prelude::{AnyChannel, FlatSamples, ReadChannels, ReadLayers, read as exr_reader};
use glam::Vec3;
use image::{DynamicImage, ImageDecoder, codecs::hdr::HdrDecoder};
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

/// Numbers decoded at most (width x height x channels, all layers): damaged headers ask for terabytes.
const LARGEST: u64 = 1 << 27;

/// A decoded file, linear Rec. 709 RGB as it stands there.
pub struct RadianceFile {
    /// Texels across.
    pub width: usize,
    /// Rows of texels from the top; as many as `width` divides, and at least one.
    pub texels: Vec<Vec3>,
}

impl RadianceFile {
    /// Decodes a file. One without colours gives grey.
    ///
    /// # Errors
    /// When it cannot be read, is of another format, has no pixels, or announces more than 2^27 numbers.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let asked = announced(path)?;
        if asked > LARGEST {
            return Err(Error::file(
                path,
                format!("expected at most {LARGEST} samples, its header says {asked}"),
            ));
        }
        let file = if is_exr(&mut open(path)?, path)? { read_exr(path)? } else { read_hdr(path)? };
        if file.width == 0 || file.texels.is_empty() {
            return Err(Error::file(path, "the image has no pixels"));
        }
        Ok(file)
    }

    /// Rows of texels.
    pub fn height(&self) -> usize {
        self.texels.len() / self.width
    }
}

/// The number of samples (width x height x channels, all layers) that a file's header announces.
///
/// # Errors
/// When it cannot be read or is of another format.
pub fn announced(path: &Path) -> Result<u64, Error> {
    samples(&mut open(path)?, path)
}

fn open(path: &Path) -> Result<BufReader<std::fs::File>, Error> {
    std::fs::File::open(path).map(BufReader::new).map_err(|e| Error::file(path, e))
}

fn is_exr(reader: &mut impl BufRead, path: &Path) -> Result<bool, Error> {
    let start = reader.fill_buf().map_err(|e| Error::file(path, e))?;
    match start {
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(true),
        [b'#', b'?', ..] => Ok(false),
        _ => Err(Error::file(path, "expected an OpenEXR or a Radiance HDR image")),
    }
}

fn samples(reader: &mut (impl BufRead + Seek), path: &Path) -> Result<u64, Error> {
    if !is_exr(reader, path)? {
        let decoder = HdrDecoder::new(reader).map_err(|e| Error::file(path, e))?;
        let (width, height) = decoder.dimensions();
        return Ok((u64::from(width) * u64::from(height)).saturating_mul(3));
    }
    let meta = MetaData::read_from_buffered(reader, false).map_err(|e| Error::file(path, e))?;
    let count = meta.headers.iter().map(|header| {
        let area =
            (header.layer_size.width() as u64).saturating_mul(header.layer_size.height() as u64);
        area.saturating_mul(header.channels.list.len() as u64)
    });
    Ok(count.fold(0, u64::saturating_add))
}

fn read_hdr(path: &Path) -> Result<RadianceFile, Error> {
    let decoder = HdrDecoder::new(open(path)?).map_err(|e| Error::file(path, e))?;
    let image =
        DynamicImage::from_decoder(decoder).map_err(|e| Error::file(path, e))?.into_rgb32f();
    let width = image.width() as usize;
    Ok(RadianceFile { width, texels: image.pixels().map(|p| Vec3::from_array(p.0)).collect() })
}

/// The first layer with red, green and blue, else the first channel of the first layer as grey.
fn read_exr(path: &Path) -> Result<RadianceFile, Error> {
    let reader = exr_reader()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes();
    let image = reader.from_file(path).map_err(|e| Error::file(path, e))?;
    let in_colour =
        image.layer_data.iter().find_map(|layer| Some((layer, colours(&layer.channel_data.list)?)));
    let grey = || {
        let layer = image.layer_data.first()?;
        let list = &layer.channel_data.list;
        let channel = list.iter().find(|c| is_called(c, &["y", "l"])).or_else(|| list.first())?;
        Some((layer, [channel; 3]))
    };
    let (layer, channels) =
        in_colour.or_else(grey).ok_or_else(|| Error::file(path, "the image has no channels"))?;
    let area = layer.size.area();
    if channels.iter().any(|c| c.sample_data.len() != area) {
        return Err(Error::file(
            path,
            "expected channels of full resolution, found subsampled ones",
        ));
    }
    let [r, g, b] = channels.map(|c| c.sample_data.values_as_f32());
    let texels = r.zip(g).zip(b).map(|((r, g), b)| Vec3::new(r, g, b)).collect();
    Ok(RadianceFile { width: layer.size.width(), texels })
}

type Channel = AnyChannel<FlatSamples>;

fn colours(list: &[Channel]) -> Option<[&Channel; 3]> {
    let find = |names: &[&str]| list.iter().find(|c| is_called(c, names));
    Some([find(&["r", "red"])?, find(&["g", "green"])?, find(&["b", "blue"])?])
}

/// Whether a channel has one of the names, whatever layer stands before it: `Sky.R` is called `r`.
fn is_called(channel: &Channel, names: &[&str]) -> bool {
    let full = channel.name.to_string().to_lowercase();
    names.contains(&full.rsplit('.').next().unwrap_or(&full))
}
