//! What the observer tells over HTTP, each client on a thread of its own: whoever asks slowly or never ends delays
//! nobody, and is sent away after [`PATIENCE`].
//!
//! A foreign web page must not read (DNS rebinding): the name that the browser asked for has to be this machine's own.
//! Still less must it move anything: that takes a POST that says it is JSON, from the page that is served here, and,
//! but for a stop, the token of the run (design notes on reliability, section 7).

use crate::actions::Action;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A client has so long to ask, and to take its answer.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest question, bytes.
const LONGEST: usize = 8192;
/// Clients at once; one more is sent away.
const CLIENTS: usize = 32;
/// What a browser must know of every answer: nothing from elsewhere, and nobody may frame or embed it.
const GUARD: &str = "Content-Security-Policy: default-src 'self'; style-src 'self' 'unsafe-inline'; frame-ancestors \
                     'none'\r\nX-Content-Type-Options: nosniff\r\nCross-Origin-Resource-Policy: same-origin\r\n\
                     Cache-Control: no-store\r\n";

/// Things done in a second; one more is refused.
const MOST_PER_S: u32 = 10;

/// What is served.
pub trait Site: Send + Sync + 'static {
    /// What a path holds, if anything.
    fn page(&self, path: &str) -> Option<Answer>;

    /// What a path asks for, if anything.
    fn action(&self, path: &str) -> Option<Action>;

    /// Does it.
    ///
    /// # Errors
    /// Why not, for people.
    fn done(&self, action: Action) -> Result<(), String>;

    /// What shows that somebody may do what is not free; `None`: nobody may.
    fn token(&self) -> Option<String>;
}

/// What a path holds.
pub struct Answer {
    /// Its media type.
    pub kind: &'static str,
    /// Its bytes.
    pub body: Vec<u8>,
}

impl Answer {
    /// A text of that media type.
    pub fn text(kind: &'static str, text: String) -> Answer {
        Answer { kind, body: text.into_bytes() }
    }
}

/// Serves a site, 404 where it has nothing; the address that it listens on.
///
/// # Errors
/// Where the address cannot be bound or there is no thread.
pub fn serve(address: SocketAddr, site: impl Site) -> std::io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    let bound = listener.local_addr()?;
    let (site, clients) = (Arc::new(site), Arc::new(AtomicUsize::new(0)));
    let pace = Arc::new(Mutex::new(Pace::default()));
    std::thread::Builder::new().name("http".to_owned()).spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                std::thread::sleep(Duration::from_millis(100));
                continue;
            };
            if clients.fetch_add(1, Ordering::Relaxed) >= CLIENTS {
                clients.fetch_sub(1, Ordering::Relaxed);
                continue;
            }
            let (site, here, pace) = (Arc::clone(&site), Arc::clone(&clients), Arc::clone(&pace));
            let started = std::thread::Builder::new().name("http client".to_owned()).spawn(move || {
                // Who goes away early is his own affair.
                let _ = answer(stream, bound, site.as_ref(), &pace);
                here.fetch_sub(1, Ordering::Relaxed);
            });
            if started.is_err() {
                clients.fetch_sub(1, Ordering::Relaxed);
            }
        }
    })?;
    Ok(bound)
}

fn answer(
    mut stream: TcpStream,
    bound: SocketAddr,
    site: &impl Site,
    pace: &Mutex<Pace>,
) -> std::io::Result<()> {
    let end = Instant::now() + PATIENCE;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut question = Vec::new();
    let mut part = [0; 1024];
    while !question.windows(4).any(|four| four == b"\r\n\r\n") {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() || question.len() > LONGEST {
            return Ok(());
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut part)? {
            0 => return Ok(()),
            count => question.extend_from_slice(&part[..count]),
        }
    }
    let question = Question(String::from_utf8_lossy(&question).into_owned());
    let plain = |text: String| Answer::text("text/plain; version=0.0.4", text);
    let (status, answer) = if !question.is_from_here(bound) {
        ("403 Forbidden", plain("this is not the name of what is served here\n".to_owned()))
    } else if let Some(path) = question.path("POST ") {
        let (status, words) = act(&question, path, site, pace);
        (status, plain(words + "\n"))
    } else {
        match question.path("GET ").and_then(|path| site.page(path)) {
            Some(answer) => ("200 OK", answer),
            None => {
                ("404 Not Found", plain("there are only /, /metrics and /frames/NUMBER here\n".to_owned()))
            }
        }
    };
    let Answer { kind, body } = answer;
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\n{GUARD}Connection: \
         close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(&body)
}

/// Does what is asked for, if who asks may; the status and what is said.
fn act(question: &Question, path: &str, site: &impl Site, pace: &Mutex<Pace>) -> (&'static str, String) {
    const FORBIDDEN: &str = "403 Forbidden";
    let Some(action) = site.action(path) else {
        return ("404 Not Found", "there is nothing to do of that name".to_owned());
    };
    // Browsers send Origin with every POST; one that is not there is no page's. A form cannot say that it is JSON.
    if question.all("origin").count() != 1 || !question.all("content-type").eq(["application/json"]) {
        return (FORBIDDEN, "only the page that is served here may ask for that".to_owned());
    }
    let shown = question.all("x-pursuit-token").next().unwrap_or_default();
    if !action.is_free() && !site.token().is_some_and(|token| is_same(&token, shown)) {
        return (FORBIDDEN, "that takes the token: open the link that `pursuit up` printed".to_owned());
    }
    if !action.is_free() && !pace.lock().unwrap_or_else(PoisonError::into_inner).allows(Instant::now()) {
        return ("429 Too Many Requests", "not so fast".to_owned());
    }
    match site.done(action) {
        Ok(()) => ("200 OK", "done".to_owned()),
        Err(why) => ("409 Conflict", why),
    }
}

/// Compared in a time that does not tell how much of it is right.
fn is_same(token: &str, shown: &str) -> bool {
    let differences = token.bytes().zip(shown.bytes()).fold(0, |all, (one, other)| all | (one ^ other));
    token.len() == shown.len() && !token.is_empty() && differences == 0
}

/// How much was done in the present second.
#[derive(Default)]
struct Pace {
    since: Option<Instant>,
    count: u32,
}

impl Pace {
    fn allows(&mut self, now: Instant) -> bool {
        if self.since.is_none_or(|since| now.duration_since(since) >= Duration::from_secs(1)) {
            (self.since, self.count) = (Some(now), 0);
        }
        self.count += 1;
        self.count <= MOST_PER_S
    }
}

/// The head of a question.
struct Question(String);

impl Question {
    /// The path that it is about, if its method is this one.
    fn path(&self, method: &str) -> Option<&str> {
        self.0.strip_prefix(method).and_then(|rest| rest.split(' ').next())
    }

    /// The values of all headers of that name.
    fn all(&self, wanted: &'static str) -> impl Iterator<Item = &str> {
        let head = self.0.split("\r\n\r\n").next().unwrap_or_default();
        head.lines().skip(1).filter_map(move |line| {
            let (name, value) = line.split_once(':')?;
            name.eq_ignore_ascii_case(wanted).then(|| value.trim())
        })
    }

    /// Whether there is exactly one Host, one of this machine's names with the port; and, where a browser says where
    /// the question comes from, that it is the page served here.
    fn is_from_here(&self, bound: SocketAddr) -> bool {
        let port = bound.port();
        let names = [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")];
        let mut hosts = self.all("host");
        let (host, more) = (hosts.next(), hosts.next());
        let is_here = |host: &str| names.iter().any(|name| name == host);
        let origin = self
            .all("origin")
            .all(|origin| origin.strip_prefix("http://").is_some_and(|origin| Some(origin) == host));
        let site = self.all("sec-fetch-site").all(|site| site == "same-origin" || site == "none");
        host.is_some_and(is_here) && more.is_none() && origin && site
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A site of which `page` is all that can be read.
    struct Plain<P> {
        page: P,
        done: Arc<Mutex<Vec<Action>>>,
    }

    impl<P: Fn(&str) -> Option<Answer> + Send + Sync + 'static> Site for Plain<P> {
        fn page(&self, path: &str) -> Option<Answer> {
            (self.page)(path)
        }

        fn action(&self, path: &str) -> Option<Action> {
            Action::of(path)
        }

        fn done(&self, action: Action) -> Result<(), String> {
            self.done.lock().unwrap().push(action);
            Ok(())
        }

        fn token(&self) -> Option<String> {
            Some("0123456789abcdef".to_owned())
        }
    }

    fn serve(
        address: SocketAddr,
        page: impl Fn(&str) -> Option<Answer> + Send + Sync + 'static,
    ) -> std::io::Result<SocketAddr> {
        super::serve(address, Plain { page, done: Arc::default() })
    }

    fn ask(address: SocketAddr, path: &str) -> String {
        ask_as(address, path, &format!("Host: {address}\r\n"))
    }

    fn ask_as(address: SocketAddr, path: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(format!("GET {path} HTTP/1.1\r\n{headers}\r\n").as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn metrics_are_served_also_after_a_client_that_says_nothing() {
        let page = Arc::new(Mutex::new("one 1\n".to_owned()));
        let of = Arc::clone(&page);
        let told = move |path: &str| {
            (path == "/metrics").then(|| Answer::text("text/plain", of.lock().unwrap().clone()))
        };
        let address = serve(([127, 0, 0, 1], 0).into(), told).unwrap();
        let _silent = TcpStream::connect(address).unwrap();
        assert!(ask(address, "/metrics").ends_with("\r\n\r\none 1\n"));
        *page.lock().unwrap() = "two 2\n".to_owned();
        assert!(ask(address, "/metrics").ends_with("two 2\n"));
        assert!(ask(address, "/").starts_with("HTTP/1.1 404"));
        assert!(serve(address, |_| None).is_err(), "a port in use is an error");
    }

    #[test]
    fn only_who_asks_for_this_machine_by_name_is_answered() {
        let address =
            serve(([127, 0, 0, 1], 0).into(), |_| Some(Answer::text("text/plain", "x".to_owned()))).unwrap();
        let port = address.port();
        let accepted = |headers: &str| ask_as(address, "/", headers).starts_with("HTTP/1.1 200");
        for host in [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")] {
            assert!(accepted(&format!("Host: {host}\r\n")), "{host}");
            assert!(accepted(&format!(
                "host: {host}\r\nOrigin: http://{host}\r\nSec-Fetch-Site: same-origin\r\n"
            )));
            assert!(!accepted(&format!("Host: {host}\r\nOrigin: http://evil.example\r\n")));
            assert!(!accepted(&format!("Host: {host}\r\nOrigin: null\r\n")));
            assert!(!accepted(&format!("Host: {host}\r\nSec-Fetch-Site: cross-site\r\n")));
            assert!(!accepted(&format!("Host: {host}\r\nHost: evil.example:{port}\r\n")));
        }
        let others = ["evil.example", "localhost", "127.0.0.1", "localhost.", "127.0.0.1:1"];
        for host in others
            .into_iter()
            .map(str::to_owned)
            .chain([format!("evil.example:{port}"), format!("localhost.:{port}")])
        {
            assert!(!accepted(&format!("Host: {host}\r\n")), "{host}");
        }
        assert!(!accepted(""), "no host at all");
    }

    #[test]
    fn a_hundred_clients_that_say_nothing_keep_nobody_out_for_long() {
        let address =
            serve(([127, 0, 0, 1], 0).into(), |_| Some(Answer::text("text/plain", "x".to_owned()))).unwrap();
        let _silent: Vec<_> = (0..100).map(|_| TcpStream::connect(address).unwrap()).collect();
        let limit = Instant::now() + Duration::from_secs(60);
        let answered = || {
            let mut stream = TcpStream::connect(address).unwrap();
            let _ = stream.write_all(format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes());
            let mut text = String::new();
            stream.read_to_string(&mut text).is_ok() && text.starts_with("HTTP/1.1 200")
        };
        while !answered() {
            assert!(Instant::now() < limit, "nobody is answered any more");
        }
    }

    #[test]
    fn who_is_not_the_page_or_has_no_token_does_nothing() {
        let done: Arc<Mutex<Vec<Action>>> = Arc::default();
        let site = Plain { page: |_: &str| None, done: Arc::clone(&done) };
        let address = super::serve(([127, 0, 0, 1], 0).into(), site).unwrap();
        let post = |path: &str, headers: &str| {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(format!("POST {path} HTTP/1.1\r\n{headers}\r\n").as_bytes()).unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text.split(' ').nth(1).unwrap_or_default().to_owned()
        };
        let host = format!("Host: {address}\r\n");
        let origin = format!("Origin: http://{address}\r\n");
        let json = "Content-Type: application/json\r\n";
        let token = "X-Pursuit-Token: 0123456789abcdef\r\n";
        let restart = "/do/restart/vision";
        for (path, headers, status) in [
            (restart, format!("{host}{origin}{json}"), "403"),
            (restart, format!("{host}{json}{token}"), "403"),
            (restart, format!("{host}{origin}{token}"), "403"),
            (restart, format!("{host}{origin}Content-Type: text/plain\r\n{token}"), "403"),
            (restart, format!("{host}{origin}{json}X-Pursuit-Token: 0123456789abcdeF\r\n"), "403"),
            (restart, format!("{host}{origin}{json}X-Pursuit-Token: \r\n"), "403"),
            (restart, format!("{host}Origin: http://evil.example\r\n{json}{token}"), "403"),
            (restart, format!("{host}Origin: http://localhost:{}\r\n{json}{token}", address.port()), "403"),
            (restart, format!("{host}{origin}{json}{token}Sec-Fetch-Site: cross-site\r\n"), "403"),
            (restart, format!("Host: evil.example\r\n{origin}{json}{token}"), "403"),
            ("/do/restart/everything", format!("{host}{origin}{json}{token}"), "404"),
            ("/do/stop", format!("{host}{json}"), "403"),
            ("/do/stop", format!("{host}Origin: null\r\n{json}"), "403"),
        ] {
            assert_eq!(post(path, &headers), status, "{path} {headers}");
        }
        assert!(done.lock().unwrap().is_empty());
        let good = format!("{host}{origin}{json}{token}");
        assert_eq!(post(restart, &good), "200");
        assert_eq!(post("/do/stop", &format!("{host}{origin}{json}")), "200", "a stop is free");
        assert!(ask(address, restart).starts_with("HTTP/1.1 404"), "a GET does nothing");
        let vision = Action::Restart(pursuit_messages::Service::Vision);
        assert_eq!(*done.lock().unwrap(), [vision, Action::Stop]);
        let codes: Vec<String> = (0..30).map(|_| post("/do/reset", &good)).collect();
        assert!(codes.iter().any(|code| code == "429"), "{codes:?}");
        assert_eq!(post("/do/stop", &format!("{host}{origin}{json}")), "200", "never too many stops");
    }
}
