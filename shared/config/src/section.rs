//! One section of a document, read key by key.

use std::ops::{Bound, RangeBounds};
use std::path::PathBuf;

use crate::checker::Checker;
use crate::document::{Entry, Node};
use crate::faults::Origin;
use crate::number::{Integer, demanded, harmless, shown};
use crate::spelling::nearest;

/// A section that is being read. Every method marks its key as known. What cannot be read is recorded as a
/// fault and answered with the default, or with a harmless value in range, so that reading goes on.
///
/// The methods without `_or` are for keys that must be there; `_or` gives the value of a missing key, which is
/// not checked against the range.
#[derive(Clone, Debug)]
pub struct Section<'c> {
    checker: &'c Checker<'c>,
    name: String,
    entry: Option<&'c Entry>,
}

impl<'c> Section<'c> {
    pub(crate) fn new(checker: &'c Checker<'c>, name: &str, entry: Option<&'c Entry>) -> Section<'c> {
        Section { checker, name: name.to_owned(), entry }
    }

    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// A finite number in `range`; whole numbers are taken too.
    pub fn float(&self, key: &str, range: impl RangeBounds<f64>) -> f64 {
        self.read_float(key, &range).unwrap_or_else(|missing| {
            self.required(key, missing, &number_demanded(&range));
            harmless(&range, 0.0)
        })
    }

    /// Like [`Section::float`], `default` when the key is missing.
    pub fn float_or(&self, key: &str, range: impl RangeBounds<f64>, default: f64) -> f64 {
        self.read_float(key, &range).unwrap_or(default)
    }

    /// A whole number in `range`.
    pub fn integer<T: Integer>(&self, key: &str, range: impl RangeBounds<T>) -> T {
        self.read_integer(key, &range).unwrap_or_else(|missing| {
            self.required(key, missing, &integer_demanded(&range));
            harmless(&range, T::ZERO)
        })
    }

    /// Like [`Section::integer`], `default` when the key is missing.
    pub fn integer_or<T: Integer>(&self, key: &str, range: impl RangeBounds<T>, default: T) -> T {
        self.read_integer(key, &range).unwrap_or(default)
    }

    /// `true` or `false`.
    pub fn flag(&self, key: &str) -> bool {
        self.read_flag(key).unwrap_or_else(|missing| {
            self.required(key, missing, "true or false");
            false
        })
    }

    /// Like [`Section::flag`], `default` when the key is missing.
    pub fn flag_or(&self, key: &str, default: bool) -> bool {
        self.read_flag(key).unwrap_or(default)
    }

    /// A text, perhaps an empty one.
    pub fn text(&self, key: &str) -> String {
        self.read_text(key, "a text in quotes").unwrap_or_else(|missing| {
            self.required(key, missing, "a text in quotes");
            String::new()
        })
    }

    /// Like [`Section::text`], `default` when the key is missing.
    pub fn text_or(&self, key: &str, default: &str) -> String {
        self.read_text(key, "a text in quotes").unwrap_or_else(|_| default.to_owned())
    }

    /// A path; a relative one is relative to the folder of the file. Whether it exists is not checked.
    pub fn path(&self, key: &str) -> PathBuf {
        self.read_path(key).unwrap_or_else(|missing| {
            self.required(key, missing, "a path in quotes");
            PathBuf::new()
        })
    }

    /// Like [`Section::path`], `default` (relative to the folder of the file as well) when the key is missing.
    pub fn path_or(&self, key: &str, default: &str) -> PathBuf {
        self.read_path(key).unwrap_or_else(|_| self.checker.document.folder.join(default))
    }

    /// A list of exactly `count` finite numbers, each in `range`.
    pub fn floats(&self, key: &str, count: usize, range: impl RangeBounds<f64>) -> Vec<f64> {
        self.read_floats(key, count, &range).unwrap_or_else(|missing| {
            self.required(key, missing, &list_demanded(count, &range));
            vec![harmless(&range, 0.0); count]
        })
    }

    /// Like [`Section::floats`], `default` when the key is missing.
    pub fn floats_or(
        &self,
        key: &str,
        count: usize,
        range: impl RangeBounds<f64>,
        default: &[f64],
    ) -> Vec<f64> {
        self.read_floats(key, count, &range).unwrap_or_else(|_| default.to_vec())
    }

    /// The value that belongs to one of the words of `choices`.
    ///
    /// # Panics
    /// When there are no choices.
    pub fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> T {
        assert!(!choices.is_empty(), "{}.{key} has no choices", self.name);
        self.read_choice(key, choices).unwrap_or_else(|missing| {
            self.required(key, missing, &choice_demanded(choices));
            choices[0].1
        })
    }

    /// Like [`Section::choice`], `default` when the key is missing.
    pub fn choice_or<T: Copy>(&self, key: &str, choices: &[(&str, T)], default: T) -> T {
        self.read_choice(key, choices).unwrap_or(default)
    }

    /// Records a fault that only the caller can see, as `section.key MESSAGE`: a value against another one.
    pub fn fault(&self, key: &str, message: impl std::fmt::Display) {
        let origin = self.get(key).map_or_else(|| self.origin(), |entry| entry.origin.clone());
        self.record(key, origin, &message.to_string());
    }

    fn get(&self, key: &str) -> Option<&'c Entry> {
        self.checker.know(&self.name, key);
        match self.entry.map(|entry| &entry.value) {
            Some(Node::Table(table)) => table.iter().find(|(known, _)| known == key).map(|(_, entry)| entry),
            _ => None,
        }
    }

    /// The section's own line; of a missing section the first line.
    fn origin(&self) -> Origin {
        self.entry.map_or(Origin::Line(1), |entry| entry.origin.clone())
    }

    fn record(&self, key: &str, origin: Origin, message: &str) {
        self.checker.fault(origin, format!("{}.{key} {message}", self.name));
    }

    /// Records a required key as missing; one that was there has had its fault already.
    fn required(&self, key: &str, problem: Problem, demanded: &str) {
        let add = match self.entry {
            Some(_) => format!("add {key} = … below [{}]", self.name),
            None => format!("add a section [{}] with {key} = …", self.name),
        };
        if problem == Problem::Missing {
            self.record(key, self.origin(), &format!("is missing, must be {demanded}; {add}"));
        }
    }

    /// Reads the value of `key` with `read`, which says what a value must be that it cannot read.
    fn read<T>(&self, key: &str, read: impl FnOnce(&Entry) -> Result<T, Refusal>) -> Result<T, Problem> {
        let entry = self.get(key).ok_or(Problem::Missing)?;
        read(entry).map_err(|refusal| {
            self.record(key, refusal.origin, &format!("is {}, must be {}", refusal.found, refusal.demanded));
            Problem::Recorded
        })
    }

    fn read_float(&self, key: &str, range: &impl RangeBounds<f64>) -> Result<f64, Problem> {
        self.read(key, |entry| float_in(entry, range))
    }

    fn read_integer<T: Integer>(&self, key: &str, range: &impl RangeBounds<T>) -> Result<T, Problem> {
        self.read(key, |entry| {
            let Node::Integer(integer) = entry.value else {
                return Err(Refusal::new(entry, integer_demanded(range)));
            };
            match T::try_from(integer) {
                Ok(value) if range.contains(&value) => Ok(value),
                _ => Err(Refusal::new(entry, demanded(range, |number| number.to_string()))),
            }
        })
    }

    fn read_flag(&self, key: &str) -> Result<bool, Problem> {
        self.read(key, |entry| match entry.value {
            Node::Flag(flag) => Ok(flag),
            _ => Err(Refusal::new(entry, "true or false (without quotes)".to_owned())),
        })
    }

    fn read_text(&self, key: &str, demanded: &str) -> Result<String, Problem> {
        self.read(key, |entry| match &entry.value {
            Node::Text(text) => Ok(text.clone()),
            _ => Err(Refusal::new(entry, demanded.to_owned())),
        })
    }

    fn read_path(&self, key: &str) -> Result<PathBuf, Problem> {
        self.read(key, |entry| match &entry.value {
            Node::Text(text) if !text.is_empty() && !text.contains('\0') => {
                Ok(self.checker.document.folder.join(text))
            }
            _ => Err(Refusal::new(entry, "a path in quotes".to_owned())),
        })
    }

    fn read_floats(
        &self,
        key: &str,
        count: usize,
        range: &impl RangeBounds<f64>,
    ) -> Result<Vec<f64>, Problem> {
        self.read(key, |entry| match &entry.value {
            Node::List(items) if items.len() == count => {
                items.iter().map(|item| float_in(item, range)).collect()
            }
            _ => Err(Refusal::new(entry, list_demanded(count, range))),
        })
    }

    fn read_choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<T, Problem> {
        self.read(key, |entry| {
            let demanded = match &entry.value {
                Node::Text(text) => match choices.iter().find(|(word, _)| word == text) {
                    Some((_, value)) => return Ok(*value),
                    None => match nearest(text, choices.iter().map(|(word, _)| *word)) {
                        Some(meant) => format!("{} (did you mean {meant:?}?)", choice_demanded(choices)),
                        None => choice_demanded(choices),
                    },
                },
                _ => choice_demanded(choices),
            };
            Err(Refusal::new(entry, demanded))
        })
    }
}

/// Why a value is not there.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Problem {
    /// The key is not given.
    Missing,
    /// It is given, and its fault is recorded.
    Recorded,
}

/// A value that was refused.
struct Refusal {
    origin: Origin,
    found: String,
    demanded: String,
}

impl Refusal {
    fn new(entry: &Entry, demanded: String) -> Refusal {
        Refusal { origin: entry.origin.clone(), found: entry.value.to_string(), demanded }
    }
}

fn float_in(entry: &Entry, range: &impl RangeBounds<f64>) -> Result<f64, Refusal> {
    let number = match entry.value {
        Node::Float(number) => number,
        Node::Integer(number) => number as f64,
        _ => return Err(Refusal::new(entry, number_demanded(range))),
    };
    if range.contains(&number) { Ok(number) } else { Err(Refusal::new(entry, demanded(range, shown))) }
}

fn number_demanded(range: &impl RangeBounds<f64>) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Unbounded, Bound::Unbounded) => "a number".to_owned(),
        _ => format!("a number {}", demanded(range, shown)),
    }
}

fn integer_demanded<T: Integer>(range: &impl RangeBounds<T>) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Unbounded, Bound::Unbounded) => "a whole number".to_owned(),
        _ => format!("a whole number {}", demanded(range, |number| number.to_string())),
    }
}

fn list_demanded(count: usize, range: &impl RangeBounds<f64>) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Unbounded, Bound::Unbounded) => format!("a list of {count} numbers"),
        _ => format!("a list of {count} numbers {}", demanded(range, shown)),
    }
}

fn choice_demanded<T>(choices: &[(&str, T)]) -> String {
    let words: Vec<String> = choices.iter().map(|(word, _)| format!("{word:?}")).collect();
    if words.len() == 1 { words.concat() } else { format!("one of {}", words.join(", ")) }
}
