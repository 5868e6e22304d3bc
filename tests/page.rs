//! The live page in a real browser: it shows what moves, its buttons do what they say, and a foreign page does
//! nothing. Debian has the browser as `chromium` and `chromium-driver`; without them the tests are skipped.

mod support;

use rustix::process::Signal;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use support::{Place, pid_of, wait_for};

/// A browser that is told what to do over WebDriver.
struct Browser {
    driver: Child,
    address: SocketAddr,
    session: String,
    profile: std::path::PathBuf,
}

/// One question over HTTP; the status and the body of its answer.
fn http(address: SocketAddr, method: &str, path: &str, body: &str) -> std::io::Result<(String, String)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(120)))?;
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nHost: {address}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{body}",
        body.len()
    )?;
    // The driver keeps the connection open, whatever it is asked: as many bytes as it says.
    let (mut text, mut part) = (Vec::new(), [0; 4096]);
    loop {
        let count = stream.read(&mut part)?;
        text.extend_from_slice(&part[..count]);
        let whole = String::from_utf8_lossy(&text).into_owned();
        if let Some((head, body)) = whole.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| {
                let (name, value) = line.split_once(':')?;
                name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse::<usize>().ok())?
            });
            if count == 0 || length.is_some_and(|length| body.len() >= length) {
                let status = head.split(' ').nth(1).unwrap_or_default().to_owned();
                return Ok((status, body.to_owned()));
            }
        }
        if count == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
    }
}

impl Browser {
    /// `None`, with a message, where there is none on this machine.
    fn start(place: &Place) -> Option<Browser> {
        let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port();
        let driver = Command::new("chromedriver")
            .arg(format!("--port={port}"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let Ok(driver) = driver else {
            eprintln!("skipped: no chromedriver here; apt-get install chromium chromium-driver");
            return None;
        };
        let address = SocketAddr::from(([127, 0, 0, 1], port));
        let profile = place.file("profile");
        let mut browser = Browser { driver, address, session: String::new(), profile };
        let up = wait_for(|| http(address, "GET", "/status", "").ok());
        assert!(up.is_some(), "chromedriver does not come up");
        let arguments = [
            "--headless=new".to_owned(),
            "--no-sandbox".to_owned(),
            "--disable-gpu".to_owned(),
            "--disable-dev-shm-usage".to_owned(),
            "--window-size=1280,1600".to_owned(),
            format!("--user-data-dir={}", browser.profile.display()),
        ];
        let wanted =
            json!({ "capabilities": { "alwaysMatch": { "goog:chromeOptions": { "args": arguments } } } });
        let (status, body) = http(address, "POST", "/session", &wanted.to_string()).expect("an answer");
        assert_eq!(status, "200", "no session: {body}");
        let body: Value = serde_json::from_str(&body).expect("JSON");
        browser.session = body["value"]["sessionId"].as_str().expect("a session").to_owned();
        Some(browser)
    }

    fn command(&self, path: &str, body: &Value) -> Value {
        let path = format!("/session/{}{path}", self.session);
        let (status, text) = http(self.address, "POST", &path, &body.to_string()).expect("an answer");
        let answer: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(status, "200", "{path}: {answer}");
        answer["value"].clone()
    }

    fn open(&self, url: &str) {
        self.command("/url", &json!({ "url": url }));
    }

    /// What a script returns.
    fn run(&self, script: &str) -> Value {
        self.command("/execute/sync", &json!({ "script": script, "args": [] }))
    }

    fn click(&self, selector: &str) {
        let found = self.command("/element", &json!({ "using": "css selector", "value": selector }));
        let element = found.as_object().and_then(|o| o.values().next()?.as_str()).expect("an element");
        self.command(&format!("/element/{element}/click"), &json!({}));
    }

    fn text(&self, id: &str) -> String {
        self.run(&format!("return document.getElementById('{id}').textContent"))
            .as_str()
            .unwrap_or("")
            .to_owned()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = http(self.address, "DELETE", &format!("/session/{}", self.session), "");
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// A page of somebody else, that tries what it can.
const EVIL: &str = r#"<!doctype html><title>evil</title><p id="log">waiting</p>
<script>
const target = location.hash.slice(1), log = [];
async function attempt(what, options) {
  try { const answer = await fetch(target + what, options); log.push(answer.status); }
  catch (error) { log.push("refused"); }
}
(async () => {
  await attempt("/do/stop", { method: "POST", body: "{}", headers: { "Content-Type": "application/json" } });
  await attempt("/do/stop", { method: "POST", body: "{}", mode: "no-cors" });
  await attempt("/live", {});
  const form = document.createElement("form"), frame = document.createElement("iframe");
  frame.name = "sink"; document.body.append(frame);
  form.method = "POST"; form.action = target + "/do/stop"; form.target = "sink"; form.enctype = "text/plain";
  document.body.append(form); form.submit();
  const framed = document.createElement("iframe");
  framed.onload = framed.onerror = () => {
    let seen = "hidden";
    try { seen = framed.contentDocument && framed.contentDocument.getElementById("stop") ? "open" : "hidden"; } catch (e) {}
    log.push(seen);
    document.getElementById("log").textContent = log.join(" ");
  };
  framed.src = target + "/"; document.body.append(framed);
})();
</script>"#;

/// Serves that page from another port.
fn evil() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let mut question = [0; 4096];
            let _ = stream.read(&mut question);
            let _ = write!(
                stream,
                "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{EVIL}",
                EVIL.len()
            );
        }
    });
    address
}

#[test]
fn the_page_shows_what_moves_and_does_what_its_buttons_say_for_nobody_else() {
    let place = Place::new();
    let Some(browser) = Browser::start(&place) else { return };
    let settings = ["run.pace=real", "observer.start=always", "observer.metrics=127.0.0.1:0"];
    let mut system = place.up(&settings.map(|set| ["--set", set]).concat());
    let before = system.wait_until_running();
    let file = |name: &str| wait_for(|| std::fs::read_to_string(place.run_dir().join(name)).ok());
    let page = format!("http://{}", file("observer.address").expect("the observer says where"));
    let token = file("page.token").expect("a token");
    let stops = || {
        std::fs::read_dir(place.run_dir())
            .expect("it is there")
            .flatten()
            .any(|entry| entry.file_name().to_string_lossy().starts_with("stop."))
    };

    // Somebody else's page first: nothing happens.
    browser.open(&format!("http://{}/#{page}", evil()));
    let log = wait_for(|| Some(browser.text("log")).filter(|text| text != "waiting"));
    assert_eq!(log.as_deref(), Some("refused refused refused hidden"), "{}", place.log());
    assert!(!stops(), "a foreign page has stopped the arm");

    // Without the token one may look, and stop.
    browser.open(&page);
    assert!(wait_for(|| browser.text("services").contains("vision").then_some(())).is_some());
    let locked = "return document.querySelector('[data-do=\"restart/vision\"]').disabled";
    assert_eq!(browser.run(locked), Value::Bool(true));
    assert_eq!(browser.run("return document.getElementById('stop').disabled"), Value::Bool(false));

    // With it: frames go by, a target is off by some centimetres, and a restart restarts.
    browser.open("about:blank");
    browser.open(&format!("{page}/#{token}"));
    let number = |id: &str| browser.text(id).trim_end_matches(" cm").parse::<f64>().ok();
    let first = wait_for(|| number("frame")).expect("frames are shown");
    assert!(wait_for(|| number("frame").filter(|frame| *frame > first + 5.0)).is_some(), "they go by");
    assert!(wait_for(|| number("off")).is_some(), "the distance to the target is shown");
    assert_eq!(browser.run("return location.hash"), "", "the token is not left in the address");
    assert!(wait_for(|| (browser.run(locked) == Value::Bool(false)).then_some(())).is_some());
    browser.click("[data-do=\"restart/vision\"]");
    let vision = pid_of(&before, "vision");
    system.wait_until_replaced("vision", vision);
    assert!(wait_for(|| browser.text("done").ends_with(": done").then_some(())).is_some());

    // Stop, and reset.
    browser.click("#stop");
    assert!(
        wait_for(|| browser.text("arm").contains("emergency stop").then_some(())).is_some(),
        "{}",
        place.log()
    );
    assert!(stops());
    assert!(wait_for(|| browser.text("arm").contains("at rest").then_some(())).is_some());
    browser.click("#reset");
    assert!(wait_for(|| browser.text("arm").contains("active").then_some(())).is_some(), "{}", place.log());
    assert!(!stops());

    drop(browser);
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}
