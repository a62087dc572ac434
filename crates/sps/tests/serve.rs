//! The service, over connections of its own.

#[path = "suite/devtools.rs"]
mod devtools;
#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
#[path = "suite/support.rs"]
mod support;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::{self, Child, Stdio};
use std::sync::LazyLock;
use std::thread;
use std::time::Duration;

use devtools::Tab;
use fuzz::{Damage, damaged, fuzz};
use proptest::prelude::*;
use proptest::sample::select;
use serde_json::{Value, json};
use support::{Ends, Scratch, expect, fitted, fitted_in, root};

/// A model of one view.
static ONE_VIEW: LazyLock<Scratch> =
    LazyLock::new(|| fitted_in(Scratch::lasting(), &["train.keep-photographs=true"]));

fn photograph(name: &str) -> PathBuf {
    root().join("fixtures/tiny-dataset/frames").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    fs::read(photograph(name)).unwrap()
}

/// What `predict --json` prints of photographs of one surface.
fn predicted(model: &Scratch, options: &str, photographs: &[PathBuf]) -> String {
    let mut command = model.sps(&format!("predict --json --group-by all @model {options}"));
    command.args(photographs).said()
}

/// The same as JSON.
fn expected(model: &Scratch, photographs: &[PathBuf]) -> Value {
    serde_json::from_str(&predicted(model, "", photographs)).unwrap()
}

/// A service that ends with the value.
struct Served {
    process: Child,
    address: SocketAddr,
}

impl Served {
    fn start(model: &Scratch, options: &str) -> Self {
        let line = format!("serve @model --listen 127.0.0.1:0 {options}");
        let mut command = model.process(&line);
        let mut process = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut said = BufReader::new(process.stdout.take().unwrap());
        said.read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("http://").unwrap();
        Self {
            process,
            address: address.parse().unwrap(),
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        let most = Some(Duration::from_secs(60));
        stream.set_read_timeout(most).unwrap();
        stream
    }

    /// A connection over which these bytes are sent.
    fn send(&self, parts: &[&[u8]]) -> TcpStream {
        let mut stream = self.connect();
        stream.write_all(&parts.concat()).unwrap();
        stream
    }

    /// The head of a request with the lines of `headers`, none of which is `host`.
    fn head(&self, line: &str, headers: &[&str]) -> String {
        let host = format!("host: {}", self.address);
        let lines = [&[host.as_str(), "connection: close"], headers].concat();
        format!("{line} HTTP/1.1\r\n{}\r\n\r\n", lines.join("\r\n"))
    }

    fn ask(&self, line: &str, headers: &[&str], body: &[u8]) -> Response {
        let length = format!("content-length: {}", body.len());
        let head = self.head(line, &[headers, &[&length]].concat());
        Response::of(self.send(&[head.as_bytes(), body]))
    }

    fn get(&self, path: &str) -> Response {
        self.ask(&format!("GET {path}"), &[], b"")
    }

    fn post(&self, path: &str, body: &[u8]) -> Response {
        self.ask(&format!("POST {path}"), &[], body)
    }

    /// Begins a request with the first bytes of a body so long, and waits until the service has it.
    fn begin(&self, path: &str, length: usize, first: &[u8]) -> TcpStream {
        let before = self.in_flight();
        let length = format!("content-length: {length}");
        let head = self.head(&format!("POST {path}"), &[&length]);
        let stream = self.send(&[head.as_bytes(), first]);
        while self.in_flight() <= before {
            thread::yield_now();
        }
        stream
    }

    /// Requests without an answer, this one among them.
    fn in_flight(&self) -> usize {
        let metrics = self.get("/metrics").text();
        let (_, rest) = metrics.split_once("\nsps_requests_in_flight ").unwrap();
        rest.lines().next().unwrap().parse().unwrap()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Response {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Response {
    /// All that comes before the connection ends.
    fn of(mut stream: TcpStream) -> Self {
        let mut all = Vec::new();
        stream.read_to_end(&mut all).unwrap();
        let end = all.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(all[..end].to_vec()).unwrap();
        Self {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head,
            body: all[end + 4..].to_vec(),
        }
    }

    fn text(&self) -> String {
        String::from_utf8(self.body.clone()).unwrap()
    }

    fn json(self) -> Value {
        assert!([200, 201].contains(&self.status), "{}", self.text());
        serde_json::from_str(&self.text()).unwrap()
    }

    /// Refused with this status; the reason has every part.
    fn refused(self, status: u16, parts: &str) {
        assert_eq!(self.status, status, "{}", self.text());
        let body: Value = serde_json::from_str(&self.text()).unwrap();
        expect(body["error"].as_str().unwrap(), parts);
    }
}

const FORM: &str = "content-type: multipart/form-data; boundary=between";

/// A form of files.
fn form(files: &[PathBuf]) -> Vec<u8> {
    let part = |path: &PathBuf| {
        let names = format!("name=\"photograph\"; filename=\"{}\"", path.display());
        let head = format!("--between\r\nContent-Disposition: form-data; {names}\r\n\r\n");
        [head.as_bytes(), &fs::read(path).unwrap(), b"\r\n"].concat()
    };
    let parts: Vec<u8> = files.iter().flat_map(part).collect();
    [&parts[..], b"--between--\r\n"].concat()
}

#[test]
fn answers_are_those_of_predict() {
    let served = Served::start(&ONE_VIEW, "");
    let jpeg = photograph("oak-01/002.jpg");
    let exr = photograph("tile-01/002.exr");
    let ask = |query: &str, files: &[PathBuf]| {
        let answer = served.ask(&format!("POST /predict{query}"), &[FORM], &form(files));
        assert_eq!(answer.status, 200);
        answer.text()
    };
    let both = [jpeg, exr];
    for files in [&both[..1], &both[1..], &both] {
        assert_eq!(ask("", files), predicted(&ONE_VIEW, "", files));
    }
    let files = &both[..1];
    for (query, options) in [("?resize=40", "--resize 40"), ("?keep-size", "--keep-size")] {
        assert_eq!(ask(query, files), predicted(&ONE_VIEW, options, files));
    }
    // Without a form and its name, by content whatever it is said to be.
    let expected = expected(&ONE_VIEW, files);
    for media in ["image/jpeg", "application/octet-stream", "image/png"] {
        let media = format!("content-type: {media}");
        let found = served.ask("POST /predict", &[&media], &bytes("oak-01/002.jpg"));
        let found = found.json();
        assert_eq!(found["estimates"], expected["estimates"]);
        let named = [&found["surface"], &found["images"]];
        assert_eq!(named, [&json!("photograph"), &json!(["photograph"])]);
    }
}

#[test]
fn maps_are_those_of_the_command() {
    let served = Served::start(&ONE_VIEW, "");
    let file = photograph("oak-01/002.jpg");
    let maps = ONE_VIEW.path("maps");
    let mut drawn = ONE_VIEW.sps("map @model fRS --resize 48 --out @maps");
    drawn.arg(&file).assert().success();

    let line = "POST /map?property=fRS&resize=48";
    let files = form(std::slice::from_ref(&file));
    let picture = served.ask(line, &[FORM], &files);
    expect(&picture.head, "content-type: image/png");
    assert!(picture.body == fs::read(maps.join("002-fRS.png")).unwrap());

    let json_of = [FORM, "accept: application/json"];
    let numbers = served.ask(line, &json_of, &files).json();
    let mut printed = ONE_VIEW.sps("map @model fRS --resize 48 --json");
    let mut printed = printed.arg(&file).json();
    assert_eq!(printed["image"], json!(file));
    printed.as_object_mut().unwrap().remove("image");
    assert_eq!(printed, numbers);
    let written = fs::read(maps.join("002-fRS.npy")).unwrap();
    let [rows, columns] = ["rows", "columns"].map(|key| numbers[key].as_u64().unwrap() as usize);
    let (places, _) = written[written.len() - 32 * rows * columns..].as_chunks();
    let places = places.iter().map(|eight| f64::from_le_bytes(*eight));
    let places: Vec<f64> = places.collect();
    for (at, key) in ["values", "low", "high", "familiar"].iter().enumerate() {
        let expected: Vec<f64> = places.iter().skip(at).step_by(4).copied().collect();
        assert_eq!(numbers[key], json!(expected), "{key}");
    }
    let expected = json!({ "window": [32, 32], "first": [16.0, 16.0] });
    let found = json!({ "window": numbers["window"], "first": numbers["centres"][0] });
    assert_eq!(found, expected);

    let known = served.post("/map?property=fRT", &bytes("oak-01/002.jpg"));
    known.refused(400, "property `fRT`; fRS");
    let none = served.post("/map", b"");
    none.refused(400, "found none; fRS, cDF");
    let two = served.ask(line, &[FORM], &form(&[file.clone(), file]));
    two.refused(400, "found 2 photographs; expected one to map");
}

#[test]
fn what_is_not_as_expected_is_named() {
    let served = Served::start(&ONE_VIEW, "--max-body 1 --max-pixels 16000");
    let refused = |path: &str, body: &[u8], status: u16, parts: &str| {
        served.post(path, body).refused(status, parts);
    };
    let whole = bytes("oak-01/002.jpg");
    let large = vec![0; (1 << 20) + 1];
    refused("/predict", &large, 413, "1048577 bytes; at most 1048576");
    // The same, of a length that is not said before.
    let head = served.head("POST /predict", &["transfer-encoding: chunked"]);
    let chunk = [head.as_bytes(), b"100001\r\n", &large, b"\r\n0\r\n\r\n"];
    Response::of(served.send(&chunk)).refused(413, "more than 1048576; at most 1048576");
    // The header of a PNG that says 65535 x 65535 pixels.
    let mut header = Vec::new();
    let encoder = png::Encoder::new(&mut header, 65535, 65535);
    drop(encoder.write_header().unwrap());
    refused("/predict", &header, 413, "65535 x 65535; 16000");
    refused("/predict?resize=45", &whole, 413, "resize; 45; 2000");
    let two = [photograph("oak-01/002.jpg"), photograph("oak-01/001.jpg")];
    let both = served.ask("POST /predict?keep-size", &[FORM], &form(&two));
    both.refused(413, "001.jpg; 32 x 32; 976");

    refused("/predict", &whole[..300], 400, "photograph; JPEG");
    let gif = "47 49 46 38; no PNG, JPEG or EXR";
    refused("/predict", b"GIF89a", 400, gif);
    refused("/predict", b"", 400, "begins with nothing");
    refused("/predict?size=3", &whole, 400, "parameter `size`; resize");
    let ask = |header: &str, body: &[u8]| served.ask("POST /predict", &[header], body);
    ask("content-type: image/gif", &whole).refused(415, "image/gif; image/png");
    ask(FORM, b"--between\r\n").refused(400, "part 1");
    ask(FORM, b"--between--").refused(400, "at least one");

    let nowhere = served.get("/predictions");
    nowhere.refused(404, "/predictions; /predict, /map");
    let got = served.get("/predict");
    assert!(got.head.contains("allow: POST"), "{}", got.head);
    got.refused(405, "found GET; expected POST");
    refused("/session/none", &whole, 404, "`none`");
    refused("/session", b"{\"wide\": 2}", 400, "wide; {\"width\": 2.0}");
    refused("/session", b"{\"width\": 0}", 400, "width; above 0");
    let health = || served.get("/health").json();
    assert_eq!(health()["status"], "ok");
    let before = health()["watch"]["surfaces"].as_u64().unwrap();
    served.post("/predict", &whole);
    let watch = &health()["watch"];
    assert_eq!(watch["surfaces"], before + 1, "{watch}");
    assert!(watch["evidence"].as_f64().unwrap() > 0.0 && watch["alarm"].is_null());
}

#[test]
fn a_body_that_does_not_come_is_not_waited_for() {
    let served = Served::start(&ONE_VIEW, "--timeout 1");
    let head = served.head("POST /predict", &["content-length: 1000"]);
    let slow = served.send(&[head.as_bytes()]);
    Response::of(slow).refused(408, "not there after 1s");
}

#[test]
fn more_than_are_taken_in_are_told_to_ask_again() {
    let served = Served::start(&ONE_VIEW, "--at-once 1");
    let first = served.begin("/predict", 1000, b"");
    let second = served.post("/predict", &bytes("oak-01/002.jpg"));
    assert!(second.head.contains("retry-after: 1"), "{}", second.head);
    second.refused(429, "found 1");
    assert_eq!(served.get("/model").status, 200);
    // The first one leaves in the middle of its body.
    drop(first);
    while served.in_flight() > 1 {
        thread::yield_now();
    }
    served.post("/predict", &bytes("oak-01/002.jpg")).json();
}

#[test]
fn many_clients_have_the_answers_that_each_would_have_alone() {
    let served = Served::start(&ONE_VIEW, "--at-once 16");
    let names = [
        "oak-01/002.jpg",
        "tile-01/002.exr",
        "oak-01/001.jpg",
        "oak-01/000.jpg",
    ];
    let expected = names.map(|name| (bytes(name), expected(&ONE_VIEW, &[photograph(name)])));
    thread::scope(|scope| {
        for client in 0..16 {
            let (served, expected) = (&served, &expected);
            scope.spawn(move || {
                for (photograph, expected) in expected.iter().cycle().skip(client).take(10) {
                    let found = served.post("/predict", photograph).json();
                    assert_eq!(found["estimates"], expected["estimates"]);
                }
            });
        }
    });
    let metrics = served.get("/metrics").text();
    for counted in ["sps_requests_total", "sps_request_seconds_count"] {
        let counted = format!("{counted}{{path=\"/predict\",status=\"200\"}} 160\n");
        expect(&metrics, &counted);
    }
}

#[test]
fn a_token_is_asked_for() {
    ONE_VIEW.write("token.txt", "a-token-of-letters\n");
    let served = Served::start(&ONE_VIEW, "--token-file @token.txt");
    let with = |header: &str| served.ask("GET /model", &[header], b"");
    assert_eq!(with("authorization: Bearer a-token-of-letters").status, 200);
    let wrong = "Bearer a-token-of-letter|Bearer a-token-of-letters2|a-token-of-letters|Bearer ";
    for wrong in wrong.split('|') {
        let wrong = &format!("authorization: {wrong}");
        with(wrong).refused(401, "token; expected that of --token-file");
    }
    let refused = served.post("/predict", &bytes("oak-01/002.jpg"));
    expect(&refused.head, "www-authenticate: Bearer");
    refused.refused(401, "found none");
    let open = ["/", "/health"].map(|path| served.get(path).status);
    assert_eq!(open, [200; 2]);
    // What was seen is not told to everybody.
    let told = served.get("/health").json();
    assert_eq!(told, json!({ "status": "ok", "watch": null }));
    let header = "authorization: Bearer a-token-of-letters";
    let told = served.ask("GET /health", &[header], b"").json();
    assert_eq!(told["watch"]["surfaces"], 0, "{told}");
}

#[test]
fn other_machines_are_not_listened_to_without_a_token() {
    let serve = |options: &str| ONE_VIEW.sps(&format!("serve @model {options}"));
    let refused = |options: &str, parts: &str| serve(options).refused(parts);
    let listens = "--listen: found 0.0.0.0:0; --token-file";
    refused("--listen 0.0.0.0:0", listens);
    ONE_VIEW.write("empty.txt", "\n");
    refused("--token-file @empty.txt", "empty.txt; expected one line");
    let [_, log] = serve("--unfamiliar 2").ended(2);
    expect(&log, "--unfamiliar; '2'; between 0 and 1");
}

#[test]
fn pages_of_elsewhere_are_not_answered() {
    let served = Served::start(&ONE_VIEW, "");
    let request = b"GET /model HTTP/1.1\r\nhost: example.org:8080\r\nconnection: close\r\n\r\n";
    Response::of(served.send(&[request])).refused(403, "`example.org:8080`; this machine");
    let from = |origin: &str| served.ask("GET /model", &[&format!("origin: {origin}")], b"");
    from("http://example.org").refused(403, "`http://example.org`");
    from("null").refused(403, "`null`");
    assert_eq!(from(&format!("http://{}", served.address)).status, 200);
}

#[test]
fn a_request_that_runs_is_answered_before_the_end() {
    let mut served = Served::start(&ONE_VIEW, "");
    let whole = bytes("oak-01/002.jpg");
    let mut stream = served.begin("/predict", whole.len(), &whole[..100]);
    let id = served.process.id().to_string();
    let told = process::Command::new("kill").arg(id).status().unwrap();
    assert!(told.success());
    // It listens no more.
    while TcpStream::connect(served.address).is_ok() {
        thread::yield_now();
    }
    stream.write_all(&whole[100..]).unwrap();
    assert!(Response::of(stream).json()["estimates"][0]["value"].is_f64());
    assert_eq!(served.process.wait().unwrap().code(), Some(0));
}

#[test]
fn surfaces_that_look_alike_are_named_and_shown() {
    let line = expected(&ONE_VIEW, &[photograph("oak-01/002.jpg")]);
    let nearest = &line["nearest"];
    let first = [&nearest[0]["surface"], &nearest[0]["distance"]];
    assert_eq!(first, [&json!("oak-01"), &json!(0.0)]);
    let served = Served::start(&ONE_VIEW, "");
    assert_eq!(served.get("/model").json()["keeps_photographs"], true);
    let kept = served.get(&format!("/surface/{}", nearest[0]["at"]));
    let kept = image::load_from_memory(&kept.body).unwrap().into_rgb8();
    let own = image::open(ONE_VIEW.path("data/frames/oak-01/002.jpg"));
    let own = own.unwrap().into_rgb8();
    assert_eq!(kept.dimensions(), own.dimensions());
    // Decoders of JPEG differ by a few levels.
    let mut both = kept.iter().zip(own.iter());
    assert!(both.all(|(a, b)| a.abs_diff(*b) <= 8));
    for other in ["/surface/100", "/surface/-1"] {
        assert!([400, 404].contains(&served.get(other).status), "{other}");
    }
}

/// Requests whose head or body is damaged: each has an answer or none, and the service goes on.
#[test]
fn damaged_requests_are_refused_within_limits() {
    let served = Served::start(&ONE_VIEW, "--max-body 1 --max-pixels 1048576");
    let jpeg = form(&[photograph("oak-01/002.jpg")]);
    let exr = bytes("tile-01/002.exr");
    let of_exr = "content-type: image/x-exr";
    let of_json = "content-type: application/json";
    let width = b"{\"width\": 2.0}".to_vec();
    let requests = [
        ("POST /predict", FORM, jpeg.clone()),
        ("POST /predict?resize=40", of_exr, exr),
        ("POST /map?property=fRS&resize=48", FORM, jpeg),
        ("POST /session", of_json, width),
        ("GET /surface/3", "accept: */*", Vec::new()),
    ];
    let cases = (select(requests.to_vec()), Damage::some(), any::<bool>());
    fuzz(
        "http",
        &cases,
        |((line, header, body), damages, in_head)| {
            let body = if in_head {
                body
            } else {
                damaged(body, &damages)
            };
            let length = format!("content-length: {}", body.len());
            let mut head = served.head(line, &[header, &length]).into_bytes();
            if in_head {
                head = damaged(head, &damages);
            }
            let mut stream = served.connect();
            // It may answer before it has read all, and leave.
            let sent = stream.write_all(&[head, body].concat());
            if sent.is_ok() && in_head {
                let _ = stream.shutdown(Shutdown::Write);
            }
            let mut answer = Vec::new();
            let _ = stream.read_to_end(&mut answer);
            let answer = String::from_utf8_lossy(&answer);
            assert!(in_head && answer.is_empty() || answer.starts_with("HTTP/1."));
            assert!(!answer.starts_with("HTTP/1.1 5"), "{answer}");
        },
    );
    assert_eq!(served.get("/health").json()["status"], "ok");
    let status = fs::read_to_string(format!("/proc/{}/status", served.process.id()));
    let peak = status.unwrap_or_default();
    let peak = peak.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak = peak.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    assert!(peak < Some(1 << 20), "it took {peak:?} KiB");
}

#[test]
fn the_page_lets_in_nothing_but_its_own() {
    let page = Served::start(&ONE_VIEW, "").get("/");
    let policy = "content-security-policy: default-src 'none'; script-src 'nonce-";
    assert!(page.head.contains(policy), "{}", page.head);
    expect(&page.head, "content-type: text/html");
}

/// What a person does who has a keyboard alone.
#[test]
fn a_person_tries_the_page() {
    let Some(mut tab) = Tab::open() else { return };
    let served = Served::start(&ONE_VIEW, "");
    let address = format!("http://{}", served.address);
    let file = photograph("oak-01/002.jpg").canonicalize().unwrap();
    let expected = expected(&ONE_VIEW, std::slice::from_ref(&file));
    let value = expected["estimates"][0]["value"].as_f64().unwrap();
    let mut grounds = Vec::new();
    for scheme in ["light", "dark"] {
        for width in [400, 800, 1600] {
            tab.show(&address, width, scheme);
            tab.wait_for("document.querySelector('#task').innerText.includes('at 0°')");
            tab.tab_to("at.type === 'file'");
            tab.choose(&file);
            tab.wait_for("document.querySelector('#estimates tbody')");
            let shown = tab.value("document.querySelector('#estimates b').innerText");
            assert_eq!(shown, format!("{value:.0}"));
            tab.wait_for("document.querySelector('#nearest img').naturalWidth === 32");
            tab.tab_to("at.value === 'cDF'");
            tab.press("Enter");
            tab.wait_for("document.querySelector('#drawing').innerText === 'Map of cDF'");
            tab.wait_for("document.querySelector('#picture').naturalWidth > 32");
            let beyond = tab.value("document.documentElement.scrollWidth - innerWidth");
            assert!(beyond.as_i64() <= Some(0), "{beyond} pixels cut at {width}");
            assert_eq!(tab.problems(), [""; 0], "at {width} pixels, {scheme}");
        }
        grounds.push(tab.value("getComputedStyle(document.body).backgroundColor"));
    }
    assert_ne!(grounds[0], grounds[1]);
}

#[test]
fn what_is_known_of_the_model() {
    let served = Served::start(&ONE_VIEW, "--unfamiliar 0.2");
    let model = served.get("/model").json();
    assert_eq!(model["views"], json!([1]));
    assert_eq!(model["about"]["angles"], json!([0.0]));
    assert_eq!([&model["level"], &model["unfamiliar"]], [0.5, 0.2]);
    assert_eq!(model["fitted_on"]["surfaces"], 6);
    let property = &model["properties"][1];
    assert_eq!(property["property"], "cDF");
    assert!(property["name"].as_str().unwrap().len() > 3, "{property}");
    let described = served.get("/openapi.json").json();
    assert_eq!(described["openapi"], "3.1.0");
}

#[test]
fn a_session_says_where_to_look_from_next() {
    let method = "methods=[{ id = \"r\", label = \"R\", kind = \"kernel-ridge\", views = 3, \
        selector = { kind = \"equidistant\" }, adaptive = { width = 1.0, calibration = 0.5 } }]";
    let model = fitted(&[method]);
    let served = Served::start(&model, "");
    let begin = |width: &str| {
        let begun = served.post("/session", format!("{{\"width\": {width}}}").as_bytes());
        assert_eq!(begun.status, 201);
        let begun = begun.json();
        (format!("/session/{}", begun["id"].as_str().unwrap()), begun)
    };
    let (path, begun) = begin("1e-9");
    let angles = served.get("/model").json()["about"]["angles"].clone();
    let angles: Vec<f64> = serde_json::from_value(angles).unwrap();
    assert_eq!(begun["next"], json!(angles[0]));
    // Views of the tiny dataset lie between -45 and 45 degrees.
    let view = |angle: &f64| photograph(&format!("oak-01/00{}.jpg", (angle + 45.0) / 22.5));
    let files: Vec<PathBuf> = angles.iter().map(view).collect();
    for views in 1..=3 {
        let looked = served.post(&path, &fs::read(&files[views - 1]).unwrap());
        let looked = looked.json();
        assert_eq!(looked["views"], json!(views));
        assert_eq!(looked["next"], json!(angles.get(views)));
        assert_eq!(looked["narrow"], json!({ "fRS": false, "cDF": false }));
        let expected = expected(&model, &files[..views]);
        assert_eq!(looked["estimates"], expected["estimates"]);
    }
    let fourth = served.post(&path, &bytes("oak-01/004.jpg"));
    fourth.refused(409, "the session is over");

    // One narrow enough after its first photograph, and then so many that it leaves.
    let (wide, _) = begin("1e9");
    let looked = served.post(&wide, &bytes("oak-01/000.jpg")).json();
    let found = [&looked["next"], &looked["narrow"]["fRS"]];
    assert_eq!(found, [&Value::Null, &json!(true)]);
    for _ in 0..64 {
        begin("1.0");
    }
    let gone = served.post(&wide, &bytes("oak-01/000.jpg"));
    gone.refused(404, "one of the last 64");
    expect(&served.get("/metrics").text(), "\nsps_sessions 64\n");
}
