//! What the observer tells over HTTP, on a thread of its own: whoever asks slowly or never ends delays no one but who asks
//! after him, and him by at most [`PATIENCE`].

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// A client has so long to ask, and to take its answer.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest question, bytes.
const LONGEST: usize = 8192;

/// Serves what `page` says of a path, 404 where it says nothing; the address that it listens on.
///
/// # Errors
/// Where the address cannot be bound or there is no thread.
pub fn serve(
    address: SocketAddr,
    page: impl Fn(&str) -> Option<String> + Send + 'static,
) -> std::io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    let bound = listener.local_addr()?;
    std::thread::Builder::new().name("metrics".to_owned()).spawn(move || {
        for stream in listener.incoming() {
            match stream {
                // Who goes away early is his own affair.
                Ok(stream) => drop(answer(stream, &page)),
                Err(_) => std::thread::sleep(Duration::from_millis(100)),
            }
        }
    })?;
    Ok(bound)
}

fn answer(mut stream: TcpStream, page: &impl Fn(&str) -> Option<String>) -> std::io::Result<()> {
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
    let (status, body) = match path.and_then(page) {
        Some(body) => ("200 OK", body),
        None => ("404 Not Found", "there are only /metrics and /frames/NUMBER here\n".to_owned()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    fn ask(address: SocketAddr, path: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn metrics_are_served_also_after_a_client_that_says_nothing() {
        let page = Arc::new(Mutex::new("one 1\n".to_owned()));
        let of = Arc::clone(&page);
        let told = move |path: &str| (path == "/metrics").then(|| of.lock().unwrap().clone());
        let address = serve(([127, 0, 0, 1], 0).into(), told).unwrap();
        let _silent = TcpStream::connect(address).unwrap();
        assert!(ask(address, "/metrics").ends_with("\r\n\r\none 1\n"));
        *page.lock().unwrap() = "two 2\n".to_owned();
        assert!(ask(address, "/metrics").ends_with("two 2\n"));
        assert!(ask(address, "/").starts_with("HTTP/1.1 404"));
        assert!(serve(address, |_| None).is_err(), "a port in use is an error");
    }
}
