//! The report page in a real browser: what it draws, what can be done with it, and that it asks
//! nobody for anything.

mod driver;

use driver::Browser;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};
use lightloom::report::{
    Axis, Cheapest, Document, Encoded, Fate, LIMIT, NodeCost, Plot, Point, Setting, Spread, page,
};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tempfile::TempDir;

fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Encoded {
    let image = RgbImage::from_fn(width, height, |x, y| Rgb(pixel(x, y)));
    let mut bytes = Vec::new();
    let (fast, none) = (CompressionType::Fast, FilterType::NoFilter);
    image.write_with_encoder(PngEncoder::new_with_quality(&mut bytes, fast, none)).unwrap();
    Encoded { bytes, extension: "png".to_owned() }
}

/// A mixed-up number: noise that is the same each time.
fn hash(x: u32, y: u32, seed: u32) -> u32 {
    let mut h =
        x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    for shift in [15, 13, 16] {
        h = (h ^ (h >> shift)).wrapping_mul(0x2C1B_3C6D);
    }
    h >> 24
}

/// A lit ball over a floor, with grain.
fn ball(width: u32, height: u32, grain: f64, seed: u32) -> Encoded {
    png(width, height, |x, y| {
        let (u, v) =
            (f64::from(x) / f64::from(width) - 0.5, f64::from(y) / f64::from(height) - 0.5);
        let (u, r2) = (u * f64::from(width) / f64::from(height), 0.11);
        let floor =
            if v > 0.25 { [0.42, 0.38, 0.33] } else { [0.30 - 0.3 * v, 0.36, 0.45 + 0.2 * v] };
        let height = r2 - u * u - v * v;
        let lit = if height > 0.0 {
            let light = ((-0.5 * u - 0.7 * v + 0.6 * height.sqrt()) / r2.sqrt()).max(0.05);
            [0.95 * light, 0.62 * light, 0.35 * light]
        } else {
            floor
        };
        let noise = grain * (f64::from(hash(x, y, seed)) / 255.0 - 0.5);
        lit.map(|c| ((c + noise).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8)
    })
}

fn cost(name: &str, kind: &str, seconds: f64, evaluations: u64, counts: bool) -> NodeCost {
    NodeCost {
        name: name.to_owned(),
        kind: kind.to_owned(),
        counts,
        executions: 3,
        seconds,
        cpu_seconds: 1.9 * seconds,
        peak_bytes: 800_000_000 + evaluations,
        bytes: 4 * evaluations + 12_000,
        evaluations,
        together: !counts,
    }
}

/// The graph of a point, with its values and characters that HTML would take for its own.
fn graph(rows: u32, clusters: u32, seed: u32) -> String {
    format!(
        "#![enable(implicit_some)]\nGraph(\n    // </script><b>&amp; not a tag\n    vars: {{ \"rows\": {rows}, \
         \"clusters\": {clusters}, \"seed\": {seed} }},\n    nodes: {{\n        \"rows\": Rows(bins: \"$rows\"),\n    }},\n)\n"
    )
}

fn spread(values: &[f64]) -> Option<Spread> {
    let count = values.len();
    let mean = values.iter().sum::<f64>() / count as f64;
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    let deviation = if count > 1 { (squares / (count - 1) as f64).sqrt() } else { 0.0 };
    (count > 0).then_some(Spread { mean, deviation, count })
}

/// Four rows times three clusters times two seeds. Both seeds of the last setting failed, and one of
/// the first; the times of two settings are marked.
fn sweep() -> Document {
    let (rows, clusters) = ([25, 49, 100, 225], [50, 200, 800]);
    let mut document = Document {
        title: "rows & clusters <pavilion>".to_owned(),
        source: "sweeps/rows.ron".to_owned(),
        made: 1_795_000_000,
        version: "0.1.0".to_owned(),
        axes: vec![
            Axis { name: "rows".to_owned(), values: rows.map(|r| r.to_string()).to_vec() },
            Axis { name: "clusters".to_owned(), values: clusters.map(|c| c.to_string()).to_vec() },
        ],
        seed: Some(Axis { name: "seed".to_owned(), values: vec!["1".to_owned(), "2".to_owned()] }),
        figures: vec!["error.relative".to_owned(), "error.flicker".to_owned()],
        plot: Plot {
            x: "evaluations".to_owned(),
            y: "error.relative".to_owned(),
            colour: Some("rows".to_owned()),
        },
        ..Document::default()
    };
    for (r, c) in rows.iter().flat_map(|r| clusters.map(|c| (*r, c))) {
        let at = document.settings.len();
        let mut setting =
            Setting { values: vec![r.to_string(), c.to_string()], ..Setting::default() };
        for seed in 1..=2 {
            let failed = at == 11 || (at == 0 && seed == 2);
            setting.points.push(document.points.len());
            let mut point = Point {
                setting: at,
                seed: Some(seed.to_string()),
                graph: graph(r, c, seed),
                ..Point::default()
            };
            if failed {
                point.fate = Fate::Failed;
                point.problem = Some("out of memory in \"reps\": needs 27 GB".to_owned());
            } else {
                let wobble = 1.0 + 0.12 * f64::from(hash(r, c, seed)) / 255.0;
                let error = wobble * (0.3 / f64::from(c).sqrt() + 1.2 / f64::from(r));
                point.fate = Fate::Done;
                point.figures = [
                    ("error.relative".to_owned(), error),
                    ("error.flicker".to_owned(), 0.2 * error * wobble),
                ]
                .into();
                let evaluations = u64::from(r) * 576_000 + u64::from(c) * 40_000;
                let seconds = evaluations as f64 / 4.1e6 * wobble;
                point.evaluations = Some(evaluations);
                point.cpu_seconds = Some(1.9 * (seconds + 0.8));
                point.together = at == 4;
                point.other_host = at == 7;
                point.nodes = vec![
                    cost("scene", "Pavilion", 0.8, 0, true),
                    cost("rows", "Rows", 0.2 * seconds, u64::from(r) * 576_000, true),
                    cost("image", "Reconstruct", 0.8 * seconds, u64::from(c) * 40_000, true),
                    cost("error", "Compare", 0.31, 0, false),
                ];
                let picture = document.pictures.len();
                document.pictures.push(ball(160, 90, 2.5 * error, at as u32 * 2 + seed));
                document.pictures.push(png(160, 90, |x, y| {
                    let e = (f64::from(hash(x, y, at as u32)) * 2.5 * error) as u8;
                    [e, e / 3, 40]
                }));
                point.pictures =
                    vec![("picture".to_owned(), picture), ("flip".to_owned(), picture + 1)];
            }
            document.points.push(point);
        }
        document.settings.push(setting);
    }
    gather(&mut document);
    document
}

/// Fills what settings know from their points.
fn gather(document: &mut Document) {
    for setting in &mut document.settings {
        let points: Vec<&Point> = setting.points.iter().map(|at| &document.points[*at]).collect();
        for name in &document.figures {
            let values: Vec<f64> =
                points.iter().filter_map(|p| p.figures.get(name).copied()).collect();
            setting.figures.extend(spread(&values).map(|s| (name.clone(), s)));
        }
        let evaluations = points.iter().filter_map(|p| p.evaluations.map(|e| e as f64));
        setting.evaluations = spread(&evaluations.collect::<Vec<_>>());
        setting.cpu_seconds =
            spread(&points.iter().filter_map(|p| p.cpu_seconds).collect::<Vec<_>>());
        setting.together = points.iter().any(|p| p.together);
        setting.other_host = points.iter().any(|p| p.other_host);
    }
    let y = document.plot.y.clone();
    let against = |of: fn(&Setting) -> Option<Spread>, settings: &[Setting]| -> Vec<_> {
        let pair = |s: &Setting| Some((of(s)?.mean, s.figures.get(&y)?.mean));
        settings.iter().map(pair).collect::<Vec<Option<(f64, f64)>>>()
    };
    let costs = [
        against(|s| s.evaluations, &document.settings),
        against(|s| s.cpu_seconds, &document.settings),
    ];
    for (at, setting) in document.settings.iter_mut().enumerate() {
        let [evaluations, cpu_seconds] = costs.each_ref().map(|all| {
            let undercut = |(x, y)| all.iter().flatten().any(|(u, v)| *u <= x && *v < y);
            all[at].is_some_and(|own| !undercut(own))
        });
        (setting.front_evaluations, setting.front_cpu_seconds) = (evaluations, cpu_seconds);
    }
    document.cheapest.extend([0.05, 0.02, 0.01].map(|target| {
        let [evaluations, cpu_seconds] = costs.each_ref().map(|all| {
            let met = all.iter().enumerate().filter_map(|(at, own)| Some((at, (*own)?)));
            let met = met.filter(|(_, (_, y))| *y <= target);
            met.min_by(|(_, (x, _)), (_, (u, _))| x.total_cmp(u)).map(|(at, _)| at)
        });
        Cheapest { target, evaluations, cpu_seconds }
    }));
}

/// One point of no sweep.
fn single() -> Document {
    let mut document = sweep();
    document.title = "quick".to_owned();
    document.axes.clear();
    document.seed = None;
    document.cheapest.clear();
    document.points = vec![Point { setting: 0, seed: None, ..document.points.swap_remove(8) }];
    document.settings = vec![Setting { points: vec![0], ..Setting::default() }];
    gather(&mut document);
    document.cheapest.clear();
    document
}

/// Writes the page of a document.
fn write(document: &Document) -> (TempDir, PathBuf) {
    let text = page(document).unwrap();
    assert!(text.len() < LIMIT);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("report.html");
    std::fs::write(&file, text).unwrap();
    (folder, file)
}

/// Opens the page of a document; the browser must have nothing to complain of, at the end neither.
fn visit(browser: &Browser, document: &Document) -> TempDir {
    let (folder, file) = write(document);
    browser.visit(&file);
    browser.wait("document.querySelector('#selected')?.children.length");
    browser.wait("[...document.images].filter((i) => i.loading !== 'lazy').every((i) => i.complete && i.naturalWidth)");
    folder
}

fn is_quiet(browser: &Browser) {
    let loud = |m: &serde_json::Value| m["level"] == "SEVERE" || m["level"] == "WARNING";
    let loud: Vec<_> = browser.console().into_iter().filter(loud).collect();
    assert!(loud.is_empty(), "{loud:?}");
    let local = |url: &str| url.starts_with("file:") || url.starts_with("data:");
    let text = browser.eval("return document.body.innerText");
    let text = text.as_str().unwrap();
    for bug in ["[object", "undefined", "NaN", "null"] {
        assert!(!text.contains(bug), "{bug} is in {text}");
    }
    let (near, far): (Vec<String>, _) = browser.requests().into_iter().partition(|url| local(url));
    assert!(!near.is_empty() && far.is_empty(), "{far:?}");
}

/// The numbers of a column of the table of settings, from the top.
fn order(browser: &Browser) -> Vec<u64> {
    let rows = browser.eval("return [...document.querySelectorAll('.settings tbody tr')].map((r) => Number(r.dataset.setting))");
    serde_json::from_value(rows).unwrap()
}

#[test]
fn a_sweep_can_be_looked_at() {
    let Some(browser) = Browser::open() else { return };
    let document = sweep();
    let _folder = visit(&browser, &document);
    let count = |selector: &str| {
        browser.eval(&format!("return document.querySelectorAll('{selector}').length"))
    };

    // Header: what failed, and what is cheapest.
    assert_eq!(browser.eval("return document.querySelector('h1').textContent"), document.title);
    assert_eq!(count("header .problems li"), 3);
    let cards =
        browser.eval("return [...document.querySelectorAll('.card')].map((c) => c.innerText)");
    let values = &document.settings[document.cheapest[0].evaluations.unwrap()].values;
    let named = format!("rows {}, clusters {}", values[0], values[1]);
    assert!(cards[0].as_str().unwrap().contains(&named), "{named} is not in {cards}");
    assert!(cards[2].as_str().unwrap().contains("not reached"), "{cards}");

    // Plot: a mark for each setting with figures, and bars for those with two values.
    assert_eq!((count(".mark"), count(".bar:not(.across)")), (json!(11), json!(10)));
    let front = document.settings.iter().filter(|s| s.front_evaluations).count();
    assert!(front > 2);
    assert_eq!(count(".settings [title^=\"on the front\"]"), front);
    assert_eq!((count("path.front"), count(".mark.hollow")), (json!(1), json!(0)));
    let axis = || browser.eval("return document.querySelector('.x-label').textContent");
    assert_eq!(axis(), "matrix elements evaluated");
    browser.click("[data-x=cpu_seconds]");
    assert_eq!(
        (axis(), count(".mark.hollow"), count(".footnote")),
        (json!("CPU time, seconds"), json!(2), json!(1))
    );

    // A click on a mark selects, and another graph is shown.
    let text = || {
        browser
            .eval("return document.querySelector('pre').textContent")
            .as_str()
            .unwrap()
            .to_owned()
    };
    for at in [2, 6] {
        browser.click(&format!(".mark[data-setting=\"{at}\"]"));
        let point = document.settings[at].points[0];
        assert_eq!(text() + "\n", document.points[point].graph);
        assert_eq!(
            browser.eval("return document.querySelector('.settings tr.selected').dataset.setting"),
            at.to_string()
        );
    }
    browser.eval("const s = document.getElementById('seed'); s.value = '2'; s.dispatchEvent(new Event('change'))");
    assert_eq!(text() + "\n", document.points[13].graph);
    assert_eq!((count(".costs tbody tr"), count(".costs .off")), (json!(4), json!(1)));

    // The table sorts both ways, and what is not known stays below.
    assert_eq!(order(&browser), (0..12).collect::<Vec<_>>());
    let error = |at: &u64| document.settings[*at as usize].figures["error.relative"].mean;
    let mut expected: Vec<u64> = (0..11).collect();
    expected.sort_by(|p, q| error(p).total_cmp(&error(q)));
    browser.click(".settings th:nth-child(4) button");
    assert_eq!(order(&browser), [expected.clone(), vec![11]].concat());
    browser.click(".settings th:nth-child(4) button");
    expected.reverse();
    assert_eq!(order(&browser), [expected, vec![11]].concat());
    browser.click(".settings tr[data-setting=\"11\"]");
    assert!(
        browser
            .eval("return document.getElementById('selected').innerText")
            .as_str()
            .unwrap()
            .contains("needs 27 GB")
    );
    is_quiet(&browser);
}

#[test]
fn the_slider_moves_by_pointer_and_by_key() {
    let Some(browser) = Browser::open() else { return };
    let _folder = visit(&browser, &sweep());
    let now = || {
        browser
            .eval("return document.querySelector('.handle').ariaValueNow")
            .as_str()
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    let clip = || {
        browser
            .eval("return getComputedStyle(document.querySelector('.stage .a')).clipPath")
            .as_str()
            .unwrap()
            .to_owned()
    };
    let handle = || {
        browser.eval("const b = document.querySelector('.handle').getBoundingClientRect(); return b.x + b.width / 2").as_f64().unwrap()
    };
    let width =
        browser.eval("return document.querySelector('.stage').clientWidth").as_f64().unwrap();
    assert_eq!(now(), 50.0);
    let (before, clipped) = (handle(), clip());
    browser.drag(".handle", (-150, 4));
    assert!((handle() - (before - 150.0)).abs() < 2.0, "{} from {before}", handle());
    assert!((now() - (50.0 - 15_000.0 / width)).abs() < 1.0);
    assert_ne!(clip(), clipped);
    let (dragged, clipped) = (now(), clip());
    browser.keys(".handle", "\u{E014}");
    browser.keys(".handle", "\u{E014}");
    assert_eq!(now(), dragged + 2.0);
    assert_ne!(clip(), clipped);
    browser.keys(".handle", "\u{E012}");
    assert_eq!(now(), dragged + 1.0);

    let style = |what: &str, of: &str| {
        browser.eval(&format!("return getComputedStyle(document.querySelector('{of}')).{what}"))
    };
    assert_eq!(style("imageRendering", ".stage img"), "pixelated");
    browser.click("[data-mode=difference]");
    assert_eq!(style("mixBlendMode", ".stage .a"), "difference");
    assert_eq!(style("filter", ".stage"), "brightness(5)");
    browser.click("[data-mode=side]");
    let places = browser.eval("return ['a', 'b'].map((k) => document.querySelector(`.stage .${k}`).getBoundingClientRect().x)");
    assert!(places[0].as_f64() < places[1].as_f64(), "{places}");
    is_quiet(&browser);
}

#[test]
fn a_difference_is_five_times_that_of_display_values() {
    let Some(browser) = Browser::open() else { return };
    let mut document = single();
    document.pictures = vec![png(64, 36, |_, _| [100, 60, 200]), png(64, 36, |_, _| [90, 71, 100])];
    document.points[0].pictures = vec![("a".to_owned(), 0), ("b".to_owned(), 1)];
    let _folder = visit(&browser, &document);
    browser.click("[data-mode=difference]");
    assert_eq!(browser.middle(".stage"), [50, 55, 255]);
    is_quiet(&browser);
}

#[test]
fn a_single_run_has_neither_plot_nor_settings() {
    let Some(browser) = Browser::open() else { return };
    let _folder = visit(&browser, &single());
    let count = |selector: &str| {
        browser.eval(&format!("return document.querySelectorAll('{selector}').length"))
    };
    assert_eq!(
        [count(".mark"), count(".settings"), count(".card"), count("#seed")],
        [0, 0, 0, 0].map(|n| json!(n))
    );
    assert_eq!(
        [count(".figures dd"), count(".stage img"), count(".costs tbody tr"), count("pre")],
        [5, 2, 4, 1].map(|n| json!(n))
    );
    is_quiet(&browser);
}

#[test]
fn what_is_not_there_is_said() {
    let Some(browser) = Browser::open() else { return };
    let shown = |document: &Document| {
        let _folder = visit(&browser, document);
        browser.eval("return document.body.innerText").as_str().unwrap().to_owned()
    };
    assert!(shown(&Document::default()).contains("There are no points."));

    let mut blank = sweep();
    blank.figures.clear();
    blank.pictures.clear();
    blank.cheapest.clear();
    for point in &mut blank.points {
        *point = Point { setting: point.setting, seed: point.seed.take(), ..Point::default() };
    }
    for setting in &mut blank.settings {
        *setting = Setting {
            values: setting.values.clone(),
            points: setting.points.clone(),
            ..Setting::default()
        };
    }
    let text = shown(&blank);
    for said in [
        "24 not run or not finished",
        "There are no figures",
        "There are no pictures",
        "No costs are known",
        "was not run",
    ] {
        assert!(text.contains(said), "{said} is not in {text}");
    }

    let mut broken = sweep();
    broken.pictures[2].bytes.truncate(90);
    broken.points[3].pictures.push(("lost".to_owned(), 999));
    broken.settings[3].figures = BTreeMap::from([(
        "error.relative".to_owned(),
        Spread { mean: f64::NAN, ..Spread::default() },
    )]);
    assert!(shown(&broken).contains("2 pictures are left out"));
    is_quiet(&browser);
}

#[test]
fn the_page_stays_small_and_fits_a_phone() {
    let Some(browser) = Browser::open() else { return };
    let mut document = sweep();
    let graph = document.points[0].graph.clone();
    document.pictures = (0..200)
        .map(|k| png(640, 360, |x, y| [0, 1, 2].map(|c| hash(x, y, 3 * k + c) as u8)))
        .collect();
    document.axes = vec![Axis {
        name: "clusters".to_owned(),
        values: (0..200).map(|k| k.to_string()).collect(),
    }];
    document.seed = None;
    document.plot.colour = None;
    document.points = (0..200)
        .map(|k| Point {
            setting: k,
            fate: Fate::Done,
            figures: [("error.relative".to_owned(), 1.0 / (k + 1) as f64)].into(),
            evaluations: Some(1000 * (k as u64 + 1)),
            pictures: vec![("picture".to_owned(), k)],
            graph: graph.replace("50", &k.to_string()),
            ..Point::default()
        })
        .collect();
    document.settings = (0..200)
        .map(|k| Setting { values: vec![k.to_string()], points: vec![k], ..Setting::default() })
        .collect();
    document.cheapest.clear();
    gather(&mut document);
    let _folder = visit(&browser, &document);
    assert_eq!(browser.eval("return document.querySelectorAll('.mark').length"), 200);
    assert!(
        browser
            .eval("return document.querySelector('header').innerText")
            .as_str()
            .unwrap()
            .contains("200 pictures are shown as a JPEG copy")
    );

    let phone = json!({ "width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": true });
    browser.command("Emulation.setDeviceMetricsOverride", phone);
    browser.wait("innerWidth === 390");
    assert_eq!(browser.eval("return document.documentElement.scrollWidth"), 390);
    is_quiet(&browser);
}
