//! The text of a configuration as a tree in which every value knows its line.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::faults::{Fault, Faults, Origin};
use crate::syntax;

/// A configuration file larger than this is a mistake (a recording, a device).
const MAX_FILE_BYTES: u64 = 1 << 20;

/// A value with the place where it was written.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub origin: Origin,
    pub value: Node,
}

/// A TOML value; numbers are finite.
#[derive(Clone, Debug)]
pub(crate) enum Node {
    Text(String),
    Integer(i64),
    Float(f64),
    Flag(bool),
    Date(toml::value::Datetime),
    List(Vec<Entry>),
    Table(Table),
}

/// Keys in the order of the file. Keys are bare words, so dotted paths are unambiguous.
pub(crate) type Table = Vec<(String, Entry)>;

/// A configuration: the text of a file, every value with its line, and the overrides applied to it.
#[derive(Clone, Debug)]
pub struct Document {
    pub(crate) name: String,
    pub(crate) folder: PathBuf,
    pub(crate) root: Table,
}

impl Document {
    /// The file at `path`; relative paths in it are relative to its folder.
    ///
    /// # Errors
    /// All syntax errors, duplicate keys and numbers that are not finite, each with its line; or why the file
    /// cannot be read.
    pub fn load(path: &Path) -> Result<Document, Faults> {
        let name = path.display().to_string();
        let unreadable = |message: String| Faults::one(&name, Origin::File, message);
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|error| unreadable(format!("cannot be read: {error}")))?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            return Err(unreadable("is larger than 1 MiB, which no configuration is".to_owned()));
        }
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
            let message = "is not UTF-8 text; save the file as UTF-8".to_owned();
            Faults::one(&name, Origin::Line(line), message)
        })?;
        Document::parse(&name, &text)
    }

    /// The configuration in `text`, which messages call `name`; relative paths in it are relative to the
    /// folder of `name`.
    ///
    /// # Errors
    /// All syntax errors, duplicate keys and numbers that are not finite, each with its line.
    pub fn parse(name: &str, text: &str) -> Result<Document, Faults> {
        let (table, errors) = DeTable::parse_recoverable(text);
        Faults::none_of(syntax::faults(name, text, &errors))?;
        let mut reader = TreeReader { name, text: Some(text), origin: Origin::File, faults: Vec::new() };
        let root = reader.table(table.get_ref(), "");
        Faults::none_of(reader.faults)?;
        let folder = Path::new(name).parent().map(Path::to_path_buf).unwrap_or_default();
        Ok(Document { name: name.to_owned(), folder, root })
    }

    /// Makes relative paths relative to `folder` instead (for an effective configuration that was written
    /// elsewhere than its source).
    pub fn set_folder(&mut self, folder: &Path) {
        folder.clone_into(&mut self.folder);
    }

    /// Overrides one value: `key` is `section.key`, `value` a TOML value; what is not TOML (a bare word, a
    /// path) is taken as text. Later faults of this value are reported as `--set KEY`.
    ///
    /// # Errors
    /// A key without section or with strange characters, an empty value, an unclosed quote or bracket, a
    /// number that is not finite, a key that names a whole section.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), Faults> {
        let origin = Origin::Override(key.to_owned());
        let refuse = |message: String| Err(Faults::one(&self.name, origin.clone(), message));
        let words: Vec<&str> = key.split('.').collect();
        let Some((last, sections)) = words.split_last().filter(|(_, sections)| !sections.is_empty()) else {
            return refuse(format!("{key:?} names no section, write section.key=value"));
        };
        if !words.iter().all(|word| is_bare(word)) {
            return refuse(format!("{key:?} is not a key, write section.key=value"));
        }
        let trimmed = value.trim();
        let entry = match DeValue::parse(trimmed) {
            Ok(parsed) => {
                let mut reader =
                    TreeReader { name: &self.name, text: None, origin: origin.clone(), faults: Vec::new() };
                let entry = reader.entry(&parsed, key);
                Faults::none_of(reader.faults)?;
                entry
            }
            Err(_) if trimmed.is_empty() => {
                return refuse(format!("{key} has no value; for an empty text write {key}='\"\"'"));
            }
            Err(error) if trimmed.starts_with(['[', '{', '"', '\'']) => {
                return refuse(format!("{key} is {trimmed}, which is not TOML: {}", error.message()));
            }
            Err(_) => Entry { origin: origin.clone(), value: Node::Text(trimmed.to_owned()) },
        };
        match put(&mut self.root, sections, last, entry, &origin) {
            Ok(()) => Ok(()),
            Err(message) => Err(Faults::one(&self.name, origin, format!("{key} {message}"))),
        }
    }

    /// The effective configuration as TOML, overrides applied, in the order of the file, without its
    /// comments. `parse` of it gives an equivalent document; relative paths stay as they were written.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        write_table(&mut out, "", &self.root);
        out
    }

    /// The value at a dotted path.
    pub(crate) fn entry(&self, path: &str) -> Option<&Entry> {
        let mut table = &self.root;
        let mut words = path.split('.').peekable();
        while let Some(word) = words.next() {
            let (_, entry) = table.iter().find(|(key, _)| key == word)?;
            match &entry.value {
                _ if words.peek().is_none() => return Some(entry),
                Node::Table(inner) => table = inner,
                _ => return None,
            }
        }
        None
    }
}

/// Whether `word` can be a key without quotes.
fn is_bare(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'-')
}

/// Puts `entry` at `sections.last`, adding sections that are missing.
fn put(
    table: &mut Table,
    sections: &[&str],
    last: &str,
    entry: Entry,
    origin: &Origin,
) -> Result<(), String> {
    let Some((section, inner)) = sections.split_first() else {
        return match table.iter_mut().find(|(key, _)| key == last) {
            Some((_, old)) if matches!(old.value, Node::Table(_)) => {
                Err("is a whole section, set one of its keys".to_owned())
            }
            Some((_, old)) => {
                *old = entry;
                Ok(())
            }
            None => {
                table.push((last.to_owned(), entry));
                Ok(())
            }
        };
    };
    let index = table.iter().position(|(key, _)| key == section).unwrap_or_else(|| {
        let empty = Entry { origin: origin.clone(), value: Node::Table(Vec::new()) };
        table.push(((*section).to_owned(), empty));
        table.len() - 1
    });
    match &mut table[index].1.value {
        Node::Table(table) => put(table, inner, last, entry, origin),
        other => Err(format!("cannot be set: {section} is {}, not a section", other)),
    }
}

/// Turns the parser's tree into ours.
struct TreeReader<'a> {
    name: &'a str,
    /// The text that spans point into; without it every value comes from `origin`.
    text: Option<&'a str>,
    origin: Origin,
    faults: Vec<Fault>,
}

impl TreeReader<'_> {
    fn table(&mut self, table: &DeTable<'_>, path: &str) -> Table {
        let mut keys: Vec<_> = table.iter().collect();
        keys.sort_by_key(|(key, _)| key.span().start);
        let mut read = Table::new();
        for (key, value) in keys {
            let word: &str = key.get_ref();
            let path = if path.is_empty() { word.to_owned() } else { format!("{path}.{word}") };
            let origin = self.origin_of(key.span().start);
            if !is_bare(word) {
                let message = format!(
                    "{path:?} is no key of a configuration; keys are letters, digits, '_' and '-' without quotes"
                );
                self.fault(origin, message);
                continue;
            }
            let entry = self.entry(value, &path);
            read.push((word.to_owned(), Entry { origin, value: entry.value }));
        }
        read
    }

    fn entry(&mut self, spanned: &Spanned<DeValue<'_>>, path: &str) -> Entry {
        let origin = self.origin_of(spanned.span().start);
        let value = match spanned.get_ref() {
            DeValue::String(text) => Node::Text(text.clone().into_owned()),
            DeValue::Boolean(flag) => Node::Flag(*flag),
            DeValue::Datetime(date) => Node::Date(*date),
            DeValue::Integer(integer) => match i64::from_str_radix(integer.as_str(), integer.radix()) {
                Ok(integer) => Node::Integer(integer),
                Err(_) => {
                    let message =
                        format!("{path} is {integer}, which is beyond the 64 bits of a whole number");
                    self.fault(origin.clone(), message);
                    Node::Integer(0)
                }
            },
            DeValue::Float(float) => match float.as_str().parse::<f64>() {
                Ok(number) if number.is_finite() => Node::Float(number),
                _ => {
                    self.fault(origin.clone(), format!("{path} is {float}, must be a finite number"));
                    Node::Float(0.0)
                }
            },
            DeValue::Array(items) => Node::List(items.iter().map(|item| self.entry(item, path)).collect()),
            DeValue::Table(table) => Node::Table(self.table(table, path)),
        };
        Entry { origin, value }
    }

    fn origin_of(&self, offset: usize) -> Origin {
        self.text.map_or_else(|| self.origin.clone(), |text| Origin::Line(syntax::line_of(text, offset)))
    }

    fn fault(&mut self, origin: Origin, message: String) {
        self.faults.push(Fault { origin, file: self.name.to_owned(), message });
    }
}

/// Writes the plain values of a section first, then its sub-sections.
fn write_table(out: &mut String, path: &str, table: &Table) {
    for (key, entry) in table {
        if !matches!(entry.value, Node::Table(_)) {
            out.push_str(&format!("{key} = {}\n", to_value(&entry.value)));
        }
    }
    for (key, entry) in table {
        if let Node::Table(inner) = &entry.value {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            let blank = if out.is_empty() { "" } else { "\n" };
            out.push_str(&format!("{blank}[{path}]\n"));
            write_table(out, &path, inner);
        }
    }
}

fn to_value(node: &Node) -> toml::Value {
    match node {
        Node::Text(text) => text.clone().into(),
        Node::Integer(integer) => (*integer).into(),
        Node::Float(float) => (*float).into(),
        Node::Flag(flag) => (*flag).into(),
        Node::Date(date) => (*date).into(),
        Node::List(items) => items.iter().map(|item| to_value(&item.value)).collect::<Vec<_>>().into(),
        Node::Table(table) => toml::Value::Table(
            table.iter().map(|(key, entry)| (key.clone(), to_value(&entry.value))).collect(),
        ),
    }
}

/// How messages show a value: `5000`, `the text "5000"`, `a list of 3`.
impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Longer texts are cut in messages.
        const MAX_CHARS: usize = 40;
        match self {
            Node::Text(text) if text.chars().count() > MAX_CHARS => {
                write!(f, "the text {:?}…", text.chars().take(MAX_CHARS).collect::<String>())
            }
            Node::Text(text) => write!(f, "the text {text:?}"),
            Node::Integer(integer) => write!(f, "{integer}"),
            Node::Float(float) => write!(f, "{float:?}"),
            Node::Flag(flag) => write!(f, "{flag}"),
            Node::Date(date) => write!(f, "the date {date}"),
            Node::List(items) => write!(f, "a list of {}", items.len()),
            Node::Table(_) => write!(f, "a section"),
        }
    }
}
