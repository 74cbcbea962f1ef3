//! A browser that does what a test says: the part of WebDriver (W3C) that the tests need.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use ureq::Agent;

/// The key under which WebDriver names elements.
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";

/// A headless browser with its driver; both end with it.
pub struct Browser {
    driver: Child,
    agent: Agent,
    session: String,
    /// Its profile.
    _profile: TempDir,
}

impl Browser {
    /// A new browser with an empty profile; none, with a visible line, when there is no driver.
    pub fn open() -> Option<Self> {
        let mut command = Command::new("chromedriver");
        let driver = command.arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut driver) = driver else {
            let skipped = "chromedriver is not installed (tests/browser/install.sh)";
            let required = std::env::var("LIGHTLOOM_BROWSER").is_ok_and(|v| v == "required");
            assert!(!required, "{skipped}");
            // Not by a macro: what those print is hidden when a test passes.
            drop(writeln!(std::io::stderr(), "skipped: {skipped}"));
            return None;
        };
        let mut lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let started = |line: String| {
            let (_, port) = line.split_once("started successfully on port ")?;
            port.trim_end_matches('.').parse::<u16>().ok()
        };
        let port = lines.by_ref().map_while(Result::ok).find_map(started).unwrap();
        let profile = tempfile::tempdir().unwrap();
        let arguments = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--window-size=1200,900",
            &format!("--user-data-dir={}", profile.path().display()),
        ];
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .proxy(None)
            .timeout_global(Some(Duration::from_secs(60)));
        let mut browser = Browser {
            driver,
            agent: config.build().into(),
            session: format!("http://127.0.0.1:{port}/session"),
            _profile: profile,
        };
        let made = browser.post(
            "",
            json!({ "capabilities": { "alwaysMatch": {
                "goog:chromeOptions": { "binary": "/usr/bin/chromium", "args": arguments },
                "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
            } } }),
        );
        browser.session += &format!("/{}", made["sessionId"].as_str().unwrap());
        Some(browser)
    }

    fn post(&self, what: &str, body: Value) -> Value {
        let answer = self.agent.post(format!("{}{what}", self.session)).send_json(&body);
        let mut answer: Value = answer.unwrap().body_mut().read_json().unwrap();
        assert!(answer["value"]["error"].is_null(), "{what} {body}: {}", answer["value"]);
        answer["value"].take()
    }

    /// Opens a file.
    pub fn visit(&self, file: &Path) {
        self.post("/url", json!({ "url": format!("file://{}", file.display()) }));
    }

    /// What a function with this body returns.
    pub fn eval(&self, body: &str) -> Value {
        self.post("/execute/sync", json!({ "script": body, "args": [] }))
    }

    /// Waits up to ten seconds until an expression is true.
    pub fn wait(&self, expression: &str) {
        let start = Instant::now();
        while self.eval(&format!("return Boolean({expression})")) != true {
            assert!(start.elapsed() < Duration::from_secs(10), "never true: {expression}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn find(&self, selector: &str) -> Value {
        self.post("/element", json!({ "using": "css selector", "value": selector }))
    }

    fn of(&self, selector: &str, what: &str, body: Value) {
        let element = self.find(selector);
        self.post(&format!("/element/{}/{what}", element[ELEMENT].as_str().unwrap()), body);
    }

    /// Clicks the first element of a CSS selector.
    pub fn click(&self, selector: &str) {
        self.of(selector, "click", json!({}));
    }

    /// Presses keys while an element has the focus.
    pub fn keys(&self, selector: &str, keys: &str) {
        self.of(selector, "value", json!({ "text": keys }));
    }

    /// Presses the middle of an element, moves by some pixels, and lets go.
    pub fn drag(&self, selector: &str, (x, y): (i32, i32)) {
        let element = self.find(selector);
        let actions = json!([
            { "type": "pointerMove", "duration": 0, "origin": element, "x": 0, "y": 0 },
            { "type": "pointerDown", "button": 0 },
            { "type": "pointerMove", "duration": 50, "origin": "pointer", "x": x, "y": y },
            { "type": "pointerUp", "button": 0 },
        ]);
        let mouse = json!({ "type": "pointer", "id": "mouse", "actions": actions });
        self.post("/actions", json!({ "actions": [mouse] }));
    }

    /// How the middle of an element looks: red, green, blue.
    pub fn middle(&self, selector: &str) -> [u8; 3] {
        let element = self.find(selector);
        let path = format!("/element/{}/screenshot", element[ELEMENT].as_str().unwrap());
        let answer = self.agent.get(format!("{}{path}", self.session)).call();
        let answer: Value = answer.unwrap().body_mut().read_json().unwrap();
        let png = STANDARD.decode(answer["value"].as_str().unwrap()).unwrap();
        let image = image::load_from_memory(&png).unwrap().into_rgb8();
        image.get_pixel(image.width() / 2, image.height() / 2).0
    }

    /// Sends a command of the browser's own protocol.
    pub fn command(&self, name: &str, parameters: Value) -> Value {
        self.post("/goog/cdp/execute", json!({ "cmd": name, "params": parameters }))
    }

    /// What the page wrote to the console, or the browser about it, since the last call.
    pub fn console(&self) -> Vec<Value> {
        self.post("/se/log", json!({ "type": "browser" })).as_array().unwrap().clone()
    }

    /// Addresses that files which were visited asked for since the last call. (The browser's own page
    /// of a new tab, which comes first, asks for many of its own.)
    pub fn requests(&self) -> Vec<String> {
        let log = self.post("/se/log", json!({ "type": "performance" }));
        let messages = log.as_array().unwrap().iter().map(|entry| {
            serde_json::from_str::<Value>(entry["message"].as_str().unwrap()).unwrap()
        });
        messages
            .filter(|m| m["message"]["method"] == "Network.requestWillBeSent")
            .map(|m| m["message"]["params"].clone())
            .filter(|of| of["documentURL"].as_str().is_some_and(|url| url.starts_with("file:")))
            .map(|of| of["request"]["url"].as_str().unwrap().to_owned())
            .collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The driver ends its browser with the session; without an answer there is nothing to end.
        drop(self.agent.delete(self.session.as_str()).call());
        drop(self.driver.kill());
        drop(self.driver.wait());
    }
}
