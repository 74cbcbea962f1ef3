//! Pictures within a number of bytes: as they are if that fits, otherwise smaller and smaller copies.

use super::Encoded;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageFormat, ImageReader};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Cursor;

/// What copies are tried, from good to bad: pixels on the longer side, and JPEG quality.
const COPIES: [(u32, u8); 14] = [
    (1920, 90),
    (1600, 85),
    (1280, 85),
    (1120, 80),
    (960, 80),
    (800, 80),
    (640, 80),
    (560, 75),
    (480, 75),
    (400, 75),
    (320, 70),
    (240, 70),
    (160, 65),
    (96, 50),
];

/// How many pictures are tried to guess the size of all.
const TRIED: usize = 16;

/// A picture of the page.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Shown {
    /// A `data:` address; none when it is left out.
    pub uri: Option<String>,
    /// Pixels across, of the original.
    pub width: u32,
    /// Pixels down, of the original.
    pub height: u32,
    /// Whether it is the original and not a copy.
    pub exact: bool,
    /// Why it is left out.
    pub problem: Option<String>,
}

impl Shown {
    /// What a picture that cannot be shown leaves.
    fn missing(problem: String) -> Self {
        Shown { problem: Some(problem), ..Shown::default() }
    }

    fn new(mime: &str, bytes: &[u8], (width, height): (u32, u32), exact: bool) -> Self {
        let uri = Some(format!("data:{mime};base64,{}", STANDARD.encode(bytes)));
        Shown { uri, width, height, exact, problem: None }
    }

    /// An upper bound of the bytes it takes in the page: an escaped character takes at most six.
    fn size(&self) -> usize {
        let fixed =
            r#"{"uri":null,"width":4294967295,"height":4294967295,"exact":false,"problem":null},"#;
        let problem = self.problem.as_ref().map_or(0, |p| 6 * p.len());
        fixed.len() + self.uri.as_ref().map_or(0, String::len) + problem
    }
}

/// Pictures that fit.
#[derive(Debug, Default, PartialEq)]
pub struct Fitted {
    /// Each different picture once.
    pub pictures: Vec<Shown>,
    /// Where each of those asked for went in `pictures`.
    pub places: BTreeMap<usize, usize>,
    /// What a reader must know.
    pub notes: Vec<String>,
}

/// A picture file that can be decoded.
struct Sound<'a> {
    bytes: &'a [u8],
    format: ImageFormat,
    size: (u32, u32),
}

/// Those of `all` that `wanted` names, within `budget` bytes of JSON.
///
/// Equal files are kept once. PNG and JPEG files stay as they are if all fit. Otherwise each is
/// replaced by a JPEG copy, unless the file is smaller than the copy. If even the smallest copies do
/// not fit, those that `wanted` names last are left out. What is not a sound PNG or JPEG file is left
/// out with its problem.
pub fn fit(all: &[Encoded], wanted: &[usize], budget: usize) -> Fitted {
    let mut places = BTreeMap::new();
    let mut files: Vec<Option<&Encoded>> = Vec::new();
    let mut seen: BTreeMap<Option<&[u8]>, usize> = BTreeMap::new();
    for &place in wanted {
        let file = all.get(place);
        let next = *seen.entry(file.map(|f| f.bytes.as_slice())).or_insert_with(|| {
            files.push(file);
            files.len() - 1
        });
        places.insert(place, next);
    }
    let checked: Vec<Result<Sound, String>> = files.par_iter().map(|file| check(*file)).collect();
    let as_they_are: Vec<Shown> = checked.par_iter().map(original).collect();
    let mut fitted = Fitted { places, ..Fitted::default() };
    let broken = checked.iter().filter(|c| c.is_err()).count();
    if let Some(problem) = checked.iter().find_map(|c| c.as_ref().err()) {
        fitted.notes.push(format!("{} left out; of the first, {problem}.", counted(broken)));
    }
    if total(&as_they_are) <= budget {
        fitted.pictures = as_they_are;
        return fitted;
    }
    let step = checked.len().div_ceil(TRIED).max(1);
    for (side, quality) in COPIES {
        let tried: Vec<Shown> = (0..checked.len())
            .into_par_iter()
            .step_by(step)
            .map(|k| copy(&checked[k], &as_they_are[k], side, quality))
            .collect();
        // Nothing is gained by a full round when even the guess is beyond the budget.
        if total(&tried) / tried.len().max(1) * checked.len() > budget {
            continue;
        }
        let copies = copies(&checked, &as_they_are, side, quality);
        if total(&copies) <= budget {
            fitted.notes.push(told(&copies, side, quality));
            fitted.pictures = copies;
            return fitted;
        }
    }
    let (side, quality) = COPIES[COPIES.len() - 1];
    let mut left = budget;
    let mut out = 0;
    for picture in copies(&checked, &as_they_are, side, quality) {
        let none = Shown::missing("left out, the page would be too large".to_owned());
        let reserve = none.size() * (checked.len() - fitted.pictures.len() - 1);
        let fits = picture.size() + reserve <= left;
        out += usize::from(!fits);
        let picture = if fits { picture } else { none };
        left = left.saturating_sub(picture.size());
        fitted.pictures.push(picture);
    }
    fitted.notes.push(told(&fitted.pictures, side, quality));
    fitted.notes.push(format!("{} left out: the page would be too large.", counted(out)));
    fitted
}

fn counted(pictures: usize) -> String {
    if pictures == 1 { "1 picture is".to_owned() } else { format!("{pictures} pictures are") }
}

fn told(copies: &[Shown], side: u32, quality: u8) -> String {
    let count = copies.iter().filter(|p| p.uri.is_some() && !p.exact).count();
    format!(
        "{} shown as a JPEG copy (quality {quality}, at most {side} pixels on the longer side), so \
         that the page stays below 5 MB. Small errors of the copies show in differences.",
        counted(count)
    )
}

fn total(pictures: &[Shown]) -> usize {
    pictures.iter().map(Shown::size).sum()
}

fn check(file: Option<&Encoded>) -> Result<Sound<'_>, String> {
    let Some(Encoded { bytes, extension }) = file else {
        return Err("its file is not there".to_owned());
    };
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let problem = |e: &dyn std::fmt::Display| format!("its {extension} file cannot be read, {e}");
    let reader = reader.map_err(|e| problem(&e))?;
    let format = reader.format().ok_or_else(|| problem(&"it is neither PNG nor JPEG"))?;
    if !matches!(format, ImageFormat::Png | ImageFormat::Jpeg) {
        return Err(problem(&"it is neither PNG nor JPEG"));
    }
    let image = reader.decode().map_err(|e| problem(&e))?;
    Ok(Sound { bytes, format, size: (image.width(), image.height()) })
}

fn original(checked: &Result<Sound, String>) -> Shown {
    match checked {
        Ok(sound) => Shown::new(sound.format.to_mime_type(), sound.bytes, sound.size, true),
        Err(problem) => Shown::missing(problem.clone()),
    }
}

fn copies(
    checked: &[Result<Sound, String>],
    as_they_are: &[Shown],
    side: u32,
    quality: u8,
) -> Vec<Shown> {
    let pairs = checked.par_iter().zip(as_they_are.par_iter());
    pairs.map(|(checked, original)| copy(checked, original, side, quality)).collect()
}

/// A JPEG copy, or the original when that is smaller.
fn copy(checked: &Result<Sound, String>, original: &Shown, side: u32, quality: u8) -> Shown {
    let Ok(sound) = checked else {
        return original.clone();
    };
    let encoded = || {
        let mut image = image::load_from_memory_with_format(sound.bytes, sound.format)?;
        if image.width().max(image.height()) > side {
            image = image.thumbnail(side, side);
        }
        let rgb = DynamicImage::from(image.into_rgb8());
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, quality).encode_image(&rgb)?;
        Ok::<_, image::ImageError>(bytes)
    };
    match encoded() {
        Ok(bytes) if bytes.len() < sound.bytes.len() => {
            Shown::new("image/jpeg", &bytes, sound.size, false)
        }
        Ok(_) => original.clone(),
        Err(e) => Shown::missing(format!("it cannot be copied, {e}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    /// A PNG that does not compress.
    fn noise(width: u32, height: u32, seed: u32) -> Encoded {
        let mut state = seed;
        let image = RgbImage::from_fn(width, height, |_, _| {
            image::Rgb([0; 3].map(|_: u8| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as u8
            }))
        });
        let mut bytes = Vec::new();
        image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
        Encoded { bytes, extension: "png".to_owned() }
    }

    fn bytes_of(shown: &Shown) -> Vec<u8> {
        STANDARD.decode(shown.uri.as_ref().unwrap().split_once(',').unwrap().1).unwrap()
    }

    #[test]
    fn what_fits_stays_as_it_is_and_equal_files_are_one() {
        let all = [noise(8, 4, 1), noise(8, 4, 2), noise(8, 4, 1)];
        let fitted = fit(&all, &[2, 0, 1], 10_000);
        assert_eq!(fitted.places, BTreeMap::from([(0, 0), (1, 1), (2, 0)]));
        assert_eq!(fitted.notes, Vec::<String>::new());
        assert_eq!(bytes_of(&fitted.pictures[0]), all[0].bytes);
        assert!(fitted.pictures.iter().all(|p| p.exact && (p.width, p.height) == (8, 4)));
    }

    #[test]
    fn what_does_not_fit_is_copied_and_the_smaller_file_wins() {
        let flat = {
            let mut bytes = Vec::new();
            let image = RgbImage::new(64, 36);
            image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
            Encoded { bytes, extension: "png".to_owned() }
        };
        let all: Vec<Encoded> = (0..20).map(|k| noise(160, 90, k)).chain([flat]).collect();
        let wanted: Vec<usize> = (0..all.len()).collect();
        let whole: usize = all.iter().map(|p| p.bytes.len()).sum();
        for budget in [whole, whole / 2, whole / 8] {
            let fitted = fit(&all, &wanted, budget);
            assert!(total(&fitted.pictures) <= budget, "{budget}");
            assert!(fitted.pictures[..20].iter().all(|p| !p.exact && p.uri.is_some()));
            assert!(fitted.pictures[20].exact);
            assert!(fitted.notes[0].starts_with("20 pictures are shown as a JPEG copy"));
            assert_eq!((fitted.pictures[0].width, fitted.pictures[0].height), (160, 90));
            let (w, h) = image::load_from_memory(&bytes_of(&fitted.pictures[3]))
                .unwrap()
                .into_rgb8()
                .dimensions();
            assert!(w <= 160 && w * 9 == h * 16, "{w} x {h}");
        }
    }

    #[test]
    fn the_last_are_left_out_when_nothing_else_helps() {
        let all: Vec<Encoded> = (0..30).map(|k| noise(200, 200, k)).collect();
        let wanted: Vec<usize> = (0..30).rev().collect();
        let fitted = fit(&all, &wanted, 40_000);
        let there = fitted.pictures.iter().take_while(|p| p.uri.is_some()).count();
        assert!(there > 0 && there < 30);
        assert!(fitted.pictures[there..].iter().all(|p| p.uri.is_none() && p.problem.is_some()));
        assert!(total(&fitted.pictures) <= 40_000);
        assert_eq!(fitted.places[&29], 0);
        assert!(fitted.notes[1].starts_with(&format!("{} pictures are left out", 30 - there)));
    }

    #[test]
    fn broken_files_are_left_out_and_told() {
        let mut cut = noise(40, 40, 1);
        cut.bytes.truncate(900);
        let text = Encoded { bytes: b"<svg/>".to_vec(), extension: "svg".to_owned() };
        let gif = Encoded { bytes: b"GIF89a\x01\0\x01\0".to_vec(), extension: "gif".to_owned() };
        for budget in [10_000, 100] {
            let all = [cut.clone(), text.clone(), gif.clone()];
            let fitted = fit(&all, &[0, 1, 2, 77], budget);
            assert!(fitted.pictures.iter().all(|p| p.uri.is_none() && p.problem.is_some()));
            assert!(fitted.notes[0].starts_with("4 pictures are left out; of the first, its png"));
            assert_eq!(fitted.places[&77], 3);
        }
        assert_eq!(fit(&[], &[], 0), Fitted::default());
    }
}
