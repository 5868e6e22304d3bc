//! The reading of a document section by section, and the report of all that is wrong with it.

use std::cell::RefCell;
use std::collections::BTreeMap;

use crate::document::{Document, Entry, Node, Table};
use crate::faults::{Fault, Faults, Origin};
use crate::section::Section;
use crate::spelling::nearest;

/// How much of the document must have been read when the check is finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Everything: a section that nobody read is a fault (the check of a whole file).
    All,
    /// Only the keys of the sections that were read (a verb that knows its own sections whole).
    ReadSections,
    /// Only the keys that were read (a service that shares sections with others, in a config that was
    /// checked whole before).
    ReadKeys,
}

/// Reads a [`Document`] and collects every fault.
#[derive(Debug)]
pub struct Checker<'a> {
    pub(crate) document: &'a Document,
    state: RefCell<State>,
}

/// What was asked for so far, and what was wrong with it.
#[derive(Debug, Default)]
struct State {
    faults: Vec<Fault>,
    /// Keys asked for, by section, in the order of asking.
    known: BTreeMap<String, Vec<String>>,
}

impl<'a> Checker<'a> {
    /// A checker that has read nothing yet.
    pub fn new(document: &'a Document) -> Checker<'a> {
        Checker { document, state: RefCell::default() }
    }

    /// The section `name` (`"camera"`, or `"services.vision"` for a sub-section); from now on it is known. A
    /// missing section reads as empty.
    pub fn section(&self, name: &str) -> Section<'_> {
        self.state.borrow_mut().known.entry(name.to_owned()).or_default();
        let entry = self.document.entry(name);
        if let Some(Entry { origin, value }) = entry
            && !matches!(value, Node::Table(_))
        {
            let message = match value {
                Node::List(_) => format!("{name} is a list, must be a section; write [{name}] once"),
                other => format!("{name} is {other}, must be a section; write [{name}]"),
            };
            self.fault(origin.clone(), message);
        }
        Section::new(self, name, entry)
    }

    /// All faults of what was read, and of what stands in the document and was not.
    ///
    /// # Errors
    /// The faults, when there are any.
    pub fn finish(self, scope: Scope) -> Result<(), Faults> {
        if scope != Scope::ReadKeys {
            self.check_table("", &self.document.root, scope);
        }
        Faults::none_of(self.state.into_inner().faults)
    }

    pub(crate) fn fault(&self, origin: Origin, message: String) {
        let file = self.document.name.clone();
        self.state.borrow_mut().faults.push(Fault { origin, file, message });
    }

    pub(crate) fn know(&self, section: &str, key: &str) {
        let mut state = self.state.borrow_mut();
        let keys = state.known.entry(section.to_owned()).or_default();
        if !keys.iter().any(|known| known == key) {
            keys.push(key.to_owned());
        }
    }

    /// Faults for what nobody asked for in the table at `path`.
    fn check_table(&self, path: &str, table: &Table, scope: Scope) {
        let keys = self.state.borrow().known.get(path).cloned();
        for (key, entry) in table {
            let full = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            if let Node::Table(inner) = &entry.value {
                let asked_as_key = keys.as_ref().is_some_and(|keys| keys.contains(key));
                if self.leads_to_known(&full) {
                    self.check_table(&full, inner, scope);
                } else if scope == Scope::All && !asked_as_key {
                    self.fault(entry.origin.clone(), self.unknown_section(&full));
                }
                continue;
            }
            match &keys {
                Some(keys) if !keys.contains(key) => {
                    self.fault(entry.origin.clone(), self.unknown_key(path, key, keys));
                }
                // The section that it should be was asked for and has complained already.
                None if self.leads_to_known(&full) => {}
                None if scope == Scope::All && path.is_empty() => {
                    self.fault(entry.origin.clone(), self.key_without_section(key));
                }
                None if scope == Scope::All => {
                    let message = format!("{full} is not a key: [{path}] holds only sections; remove it");
                    self.fault(entry.origin.clone(), message);
                }
                _ => {}
            }
        }
    }

    /// Whether `path` or something below it is a known section.
    fn leads_to_known(&self, path: &str) -> bool {
        let below = format!("{path}.");
        self.state.borrow().known.keys().any(|known| known == path || known.starts_with(&below))
    }

    fn unknown_section(&self, name: &str) -> String {
        let state = self.state.borrow();
        match nearest(name, state.known.keys().map(String::as_str)) {
            Some(meant) => format!("{name} is not a section, did you mean [{meant}]?"),
            None => {
                let known = state.known.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                format!("{name} is not a section; there are {known}")
            }
        }
    }

    fn unknown_key(&self, section: &str, key: &str, keys: &[String]) -> String {
        if let Some(meant) = nearest(key, keys.iter().map(String::as_str)) {
            return format!("{section}.{key} is not a key of [{section}], did you mean {meant}?");
        }
        match self.section_with(key) {
            Some(other) => {
                format!("{section}.{key} is not a key of [{section}], but of [{other}]; move it there")
            }
            None if keys.is_empty() => {
                format!("{section}.{key} is not a key: [{section}] has none; remove it")
            }
            None => {
                format!("{section}.{key} is not a key of [{section}]; its keys are {}", keys.join(", "))
            }
        }
    }

    fn key_without_section(&self, key: &str) -> String {
        match self.section_with(key) {
            Some(section) => format!("{key} stands before the first section, move it below [{section}]"),
            None => format!("{key} stands before the first section and is not a key; remove it"),
        }
    }

    fn section_with(&self, key: &str) -> Option<String> {
        let state = self.state.borrow();
        state
            .known
            .iter()
            .find(|(_, keys)| keys.iter().any(|known| known == key))
            .map(|(name, _)| name.clone())
    }
}
