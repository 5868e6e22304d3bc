//! The TOML parser's errors in the words of someone who edits a configuration.

use toml::de::Error;

use crate::faults::{Fault, Origin};

/// The line of a byte offset, counted from 1.
pub(crate) fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// One fault for each faulty line: the parser goes on after an error, and what else it finds in the same line
/// only follows from the first.
pub(crate) fn faults(name: &str, text: &str, errors: &[Error]) -> Vec<Fault> {
    let mut spans: Vec<_> = errors.iter().map(|error| (error.span().unwrap_or(0..0), error)).collect();
    spans.sort_by_key(|(span, _)| span.start);
    let mut faults: Vec<Fault> = Vec::new();
    for (span, error) in spans {
        let origin = Origin::Line(line_of(text, span.start));
        if faults.last().is_none_or(|fault| fault.origin != origin) {
            let message = message(text, span, error);
            faults.push(Fault { origin, file: name.to_owned(), message });
        }
    }
    faults
}

fn message(text: &str, span: std::ops::Range<usize>, error: &Error) -> String {
    let written = text.get(span.clone()).unwrap_or_default();
    let line_start = text[..span.start].rfind('\n').map_or(0, |newline| newline + 1);
    let line = text[line_start..].lines().next().unwrap_or_default().trim();
    let place = place(text, span.start);
    let subject = place.as_deref().unwrap_or("the text");
    match error.message() {
        "duplicate key" if line.starts_with('[') && key_of(line).is_none() => {
            format!("the section [{written}] is there twice, or is a key already; write it once")
        }
        "duplicate key" => format!("{subject} is set twice; remove one"),
        message if is_about_a_word(message) => match value_of(line) {
            "" => format!("{subject} has no value"),
            value => format!("{subject} is {value}, which is not TOML; a text needs quotes: {value:?}"),
        },
        message => format!("{subject} is not TOML: {message}"),
    }
}

/// Whether the parser saw a bare word where it wanted a value (one with `t` or `f` it takes for a boolean).
fn is_about_a_word(message: &str) -> bool {
    message.starts_with("string values must be quoted") || message.starts_with("invalid boolean")
}

/// What a line sets its key to, without a comment.
fn value_of(line: &str) -> &str {
    let value = line.split_once('=').map_or(line, |(_, value)| value);
    value.split('#').next().unwrap_or_default().trim()
}

/// `section.key` of an offset, as far as a faulty text tells it.
fn place(text: &str, offset: usize) -> Option<String> {
    let end = text[offset..].find('\n').map_or(text.len(), |newline| offset + newline);
    let mut key = None;
    for line in text[..end].lines().rev() {
        let line = line.trim();
        if let Some(header) = line.strip_prefix('[') {
            let section = header.trim_start_matches('[').split([']', '#']).next().unwrap_or_default().trim();
            if key.is_none() {
                return Some(format!("[{section}]"));
            }
            return key.map(|key| format!("{section}.{key}"));
        }
        if key.is_none() {
            key = key_of(line);
        }
    }
    key.map(str::to_owned)
}

/// The key that a line sets; of a line without `=` its first word.
fn key_of(line: &str) -> Option<&str> {
    let is_key = |key: &str| {
        !key.is_empty() && key.bytes().all(|b| b.is_ascii_alphanumeric() || b"_-.\"' ".contains(&b))
    };
    match line.split_once('=') {
        Some((key, _)) => Some(key.trim()).filter(|key| is_key(key)),
        None => {
            line.split_whitespace().next().filter(|word| word.starts_with(|c: char| c.is_ascii_alphabetic()))
        }
    }
}
