//! Values of public tools for the five pairs, against which the metrics are tested.

use super::errors::{Sums, error99, peak, psnr, psnr_linear};
use super::pairs::pairs;
use super::ssim::ssim;
use super::trial::pair;
use super::yee::{View, different};
use crate::data::Image;
use std::path::Path;

/// Made by `published.py` with numpy 2.4.6, scikit-image 0.26.0 and OpenImageIO 3.2.2.0.
#[rustfmt::skip]
const PUBLISHED: &[(&str, &str, f64)] = &[
    ("noise", "rmse", 0.07092346158149833),
    ("noise", "rel_mse", 0.019554135284285568),
    ("noise", "error99", 0.15754314929246893),
    ("noise", "psnr", 25.936974929792708),
    ("noise", "psnr_linear", 20.80518875884641),
    ("noise", "ssim", 0.4751037562456864),
    ("noise", "different", 5790.0),
    ("noise", "different_near", 5817.0),
    ("blur", "rmse", 0.11306711883323368),
    ("blur", "rel_mse", 0.4383967655560339),
    ("blur", "error99", 0.24444448947906494),
    ("blur", "psnr", 18.311142926787745),
    ("blur", "psnr_linear", 18.487745483683785),
    ("blur", "ssim", 0.7581427417076854),
    ("blur", "different", 2993.0),
    ("blur", "different_near", 2993.0),
    ("shift", "rmse", 0.15122174554936532),
    ("shift", "rel_mse", 0.2828315319055422),
    ("shift", "error99", 0.5599784979969256),
    ("shift", "psnr", 18.03076476370666),
    ("shift", "psnr_linear", 14.86988895008238),
    ("shift", "ssim", 0.5572493553512562),
    ("shift", "different", 2100.0),
    ("shift", "different_near", 2103.0),
    ("hdr", "rmse", 601.8864114076562),
    ("hdr", "rel_mse", 24.979141553533548),
    ("hdr", "error99", 13.631239013671824),
    ("hdr", "psnr", 28.415746298381094),
    ("hdr", "psnr_linear", 2.8985591449415002),
    ("hdr", "ssim", 0.8549394798864044),
    ("hdr", "different", 70.0),
    ("hdr", "different_near", 75.0),
    ("dark", "rmse", 0.039535877649418606),
    ("dark", "rel_mse", 0.0594012199986699),
    ("dark", "error99", 0.1265134300291533),
    ("dark", "psnr", 23.307360404578773),
    ("dark", "psnr_linear", 21.651001477014535),
    ("dark", "ssim", 0.9307217251004606),
    ("dark", "different", 73.0),
    ("dark", "different_near", 740.0),
];

#[test]
fn values_are_those_of_public_tools() {
    assert!(!PUBLISHED.is_empty());
    let pairs = pairs();
    for &(name, metric, published) in PUBLISHED {
        let (_, test, reference) = pairs.iter().find(|pair| pair.0 == name).expect("a pair");
        let pair = pair(test, reference);
        let sums = Sums::of(&pair, 1e-2);
        let yee = |luminance, fov| different(&pair, View { fov, luminance }) as f64;
        let (found, tolerance) = match (name, metric) {
            (_, "rmse") => (sums.mean_square().sqrt(), 1e-13),
            (_, "rel_mse") => (sums.relative / sums.values, 1e-13),
            (_, "error99") => (error99(&pair), 1e-13),
            (_, "psnr") => (psnr(&pair, &sums, peak(&pair)), 1e-13),
            (_, "psnr_linear") => (psnr_linear(&sums, peak(&pair)), 1e-13),
            (_, "ssim") => (ssim(&pair, 1.0), 1e-13),
            // OpenImageIO counts 59 pixels less. Along the left and right border the brightness is a
            // straight line, without contrast; blurs of single precision, as its are, leave a rounding
            // there that counts as contrast and raises the threshold.
            ("dark", "different") => (yee(100.0, 45.0), 59.0 / published),
            (_, "different") => (yee(100.0, 45.0), 0.0),
            (_, "different_near") => (yee(300.0, 10.0), 0.0),
            (_, other) => panic!("no metric is called {other}"),
        };
        let off = (found - published).abs();
        assert!(off <= tolerance * published.abs(), "{name} {metric}: {found} not {published}");
    }
}

#[test]
#[ignore = "writes the pairs for published.py"]
fn writes_the_pairs() {
    let folder = std::env::var_os("LIGHTLOOM_PAIRS").expect("LIGHTLOOM_PAIRS names a folder");
    for (name, test, reference) in &pairs() {
        for (part, image) in [("test", test), ("reference", reference)] {
            let path = Path::new(&folder).join(format!("{name}.{part}.pfm"));
            std::fs::write(path, pfm(image)).expect("the folder can be written");
        }
    }
}

/// A Portable Float Map: rows from the bottom up, little-endian.
fn pfm(image: &Image) -> Vec<u8> {
    let (width, height) = image.size();
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    for row in image.radiance.chunks(width).rev() {
        bytes.extend(row.iter().flat_map(|rgb| rgb.to_array()).flat_map(f32::to_le_bytes));
    }
    bytes
}
