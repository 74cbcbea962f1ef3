//! The report page in a real browser: what it draws, what can be done with it, and that it asks
//! nobody for anything.

mod documents;
mod driver;

use documents::{gather, hash, png, single, sweep};
use driver::Browser;
use lightloom::report::{Axis, Document, Fate, LIMIT, Point, Setting, Spread, page};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tempfile::TempDir;

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
