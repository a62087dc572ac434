//! A browser without a window that is told what to do, by Chromium's DevTools protocol over two pipes.

#![allow(dead_code, reason = "each test program uses a part")]

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{self, Child, Stdio};

use serde_json::{Value, json};
use tempfile::TempDir;

/// What a browser may be called.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

pub(crate) struct Tab {
    process: Child,
    to: File,
    from: BufReader<File>,
    session: Option<String>,
    calls: u64,
    /// What came beside answers.
    events: Vec<Value>,
    _folder: TempDir,
}

impl Tab {
    /// An empty tab; none, with a line that says so, where no browser is installed.
    pub(crate) fn open() -> Option<Self> {
        let is_there = |name: &&str| {
            let version = process::Command::new(name).arg("--version").output();
            version.is_ok_and(|output| output.status.success())
        };
        let Some(name) = BROWSERS.into_iter().find(is_there) else {
            println!("SKIPPED: none of {} is installed", BROWSERS.join(", "));
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let [to, from] = ["to", "from"].map(|name| folder.path().join(name));
        let made = process::Command::new("mkfifo").arg(&to).arg(&from).status();
        assert!(made.unwrap().success());
        let options = "--headless --no-sandbox --disable-gpu --remote-debugging-pipe --no-first-run \
            --disable-background-networking --user-data-dir=profile";
        // It reads from 3 and writes to 4.
        let process = process::Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3< to 4> from", name])
            .args(options.split_whitespace())
            .current_dir(folder.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut tab = Self {
            process,
            to: File::options().write(true).open(to).unwrap(),
            from: BufReader::new(File::open(from).unwrap()),
            session: None,
            calls: 0,
            events: Vec::new(),
            _folder: folder,
        };
        let target = tab.call("Target.createTarget", json!({ "url": "about:blank" }));
        let target = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = tab.call("Target.attachToTarget", target);
        tab.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log"] {
            tab.call(&format!("{domain}.enable"), json!({}));
        }
        let taken = json!({ "enabled": true });
        tab.call("Page.setInterceptFileChooserDialog", taken);
        Some(tab)
    }

    /// What the browser answers.
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut call = json!({ "id": self.calls, "method": method });
        call["params"] = parameters;
        if let Some(session) = &self.session {
            call["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{call}\0").as_bytes()).unwrap();
        loop {
            let mut said = self.read();
            if said["id"] == self.calls {
                assert!(said["error"].is_null(), "{method}: {}", said["error"]);
                return said["result"].take();
            }
            self.events.push(said);
        }
    }

    fn read(&mut self) -> Value {
        let mut said = Vec::new();
        self.from.read_until(0, &mut said).unwrap();
        assert_eq!(said.pop(), Some(0), "the browser ended");
        serde_json::from_slice(&said).unwrap()
    }

    fn event(&mut self, method: &str) -> Value {
        loop {
            let mut events = self.events.iter();
            if let Some(at) = events.position(|event| event["method"] == method) {
                return self.events.remove(at)["params"].take();
            }
            let said = self.read();
            self.events.push(said);
        }
    }

    /// Shows a page in a window so wide.
    pub(crate) fn show(&mut self, address: &str, width: usize, scheme: &str) {
        let window =
            json!({ "width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", window);
        let scheme = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": scheme }));
        self.call("Page.navigate", json!({ "url": address }));
        self.event("Page.loadEventFired");
    }

    /// The value of a script, once it is there.
    pub(crate) fn value(&mut self, script: &str) -> Value {
        let script = json!({ "expression": script, "awaitPromise": true, "returnByValue": true });
        let mut answer = self.call("Runtime.evaluate", script);
        let thrown = &answer["exceptionDetails"];
        assert!(thrown.is_null(), "{thrown}");
        answer["result"]["value"].take()
    }

    /// Waits until a condition holds.
    pub(crate) fn wait_for(&mut self, condition: &str) {
        let script = format!(
            "new Promise((done, fail) => {{
                setTimeout(() => fail(new Error(document.body.innerText)), 60000);
                const look = () => {condition} ? done() : requestAnimationFrame(look);
                look();
            }})"
        );
        self.value(&script);
    }

    pub(crate) fn press(&mut self, key: &str) {
        let (code, text) = if key == "Tab" { (9, "") } else { (13, "\r") };
        for kind in ["keyDown", "keyUp"] {
            let key =
                json!({ "type": kind, "key": key, "windowsVirtualKeyCode": code, "text": text });
            self.call("Input.dispatchKeyEvent", key);
        }
    }

    /// Goes on to the first thing that takes the keyboard and for which a condition holds.
    pub(crate) fn tab_to(&mut self, condition: &str) {
        for _ in 0..60 {
            self.press("Tab");
            if self.value(&format!("(at => {condition})(document.activeElement)")) == true {
                return;
            }
        }
        panic!("the key Tab never leads to where {condition}");
    }

    /// Presses Enter where files are asked for, and names this one.
    pub(crate) fn choose(&mut self, file: &Path) {
        self.press("Enter");
        let chooser = self.event("Page.fileChooserOpened");
        let files = json!({ "files": [file], "backendNodeId": chooser["backendNodeId"] });
        self.call("DOM.setFileInputFiles", files);
    }

    /// What the page printed, was refused or did not catch.
    pub(crate) fn problems(&self) -> Vec<String> {
        const PROBLEMS: [&str; 3] = [
            "Runtime.exceptionThrown",
            "Runtime.consoleAPICalled",
            "Log.entryAdded",
        ];
        let problem = |event: &&Value| PROBLEMS.iter().any(|problem| event["method"] == *problem);
        let problems = self.events.iter().filter(problem);
        problems.map(Value::to_string).collect()
    }
}

impl Drop for Tab {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
