//! What the observer tells over HTTP, each client on a thread of its own: whoever asks slowly or never ends delays
//! nobody, and is sent away after [`PATIENCE`].
//!
//! Reading only. A foreign web page must not read either (DNS rebinding): the name that the browser asked for has to
//! be this machine's own (design notes on reliability, section 7).

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
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

/// Serves what `page` says of a path, 404 where it says nothing; the address that it listens on.
///
/// # Errors
/// Where the address cannot be bound or there is no thread.
pub fn serve(
    address: SocketAddr,
    page: impl Fn(&str) -> Option<Answer> + Send + Sync + 'static,
) -> std::io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    let bound = listener.local_addr()?;
    let (page, clients) = (Arc::new(page), Arc::new(AtomicUsize::new(0)));
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
            let (page, here) = (Arc::clone(&page), Arc::clone(&clients));
            let started = std::thread::Builder::new().name("http client".to_owned()).spawn(move || {
                // Who goes away early is his own affair.
                let _ = answer(stream, bound, page.as_ref());
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
    page: &(impl Fn(&str) -> Option<Answer> + ?Sized),
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
    let question = String::from_utf8_lossy(&question);
    let path = question.strip_prefix("GET ").and_then(|rest| rest.split(' ').next());
    let plain = |text: &str| Answer::text("text/plain; version=0.0.4", text.to_owned());
    let (status, answer) = if !is_from_here(&question, bound) {
        ("403 Forbidden", plain("this is not the name of what is served here\n"))
    } else {
        match path.and_then(page) {
            Some(answer) => ("200 OK", answer),
            None => ("404 Not Found", plain("there are only /, /metrics and /frames/NUMBER here\n")),
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

/// Whether there is exactly one Host, one of this machine's names with the port; and, where a browser says where the
/// question comes from, that it is the page served here.
fn is_from_here(question: &str, bound: SocketAddr) -> bool {
    let port = bound.port();
    let names = [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")];
    let all = |wanted: &'static str| {
        question.lines().skip(1).filter_map(move |line| {
            let (name, value) = line.split_once(':')?;
            name.eq_ignore_ascii_case(wanted).then(|| value.trim())
        })
    };
    let mut hosts = all("host");
    let is_here = |host: &str| names.iter().any(|name| name == host);
    let one = hosts.next().is_some_and(is_here) && hosts.next().is_none();
    let origin = all("origin").all(|origin| origin.strip_prefix("http://").is_some_and(is_here));
    let site = all("sec-fetch-site").all(|site| site == "same-origin" || site == "none");
    one && origin && site
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

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
}
