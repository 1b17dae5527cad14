//! The list of one-line changes in `tools/mutants` fits the sources. An entry whose text is not in its file would
//! change nothing, and so test nothing.

use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    suite: BTreeMap<String, Suite>,
    mutant: Vec<Mutant>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Suite {
    package: String,
    target: Vec<String>,
    #[serde(default)]
    tests: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mutant {
    name: String,
    file: String,
    search: String,
    replace: String,
    about: String,
    suites: Vec<String>,
    #[serde(default)]
    survives: Option<String>,
}

impl Mutant {
    /// Why the entry does not fit the text of its file, if so.
    fn problem(&self, text: &str) -> Option<String> {
        let count = text.matches(&self.search).count();
        if count != 1 {
            return Some(format!(
                "{}: `{}` is {count} times in {}, expected once",
                self.name, self.search, self.file
            ));
        }
        let line_breaks = self.search.contains('\n') || self.replace.contains('\n');
        let says_nothing = self.about.is_empty() || self.survives.as_deref() == Some("");
        (line_breaks || self.search == self.replace || says_nothing)
            .then(|| format!("{}: expected another text within one line, and what it does", self.name))
    }
}

fn list() -> List {
    toml::from_str(include_str!("../../tools/mutants/list.toml")).expect("a list of suites and mutants")
}

#[test]
fn every_mutant_applies_exactly_once() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let problems: Vec<String> = list()
        .mutant
        .iter()
        .filter_map(|mutant| match std::fs::read_to_string(repository.join(&mutant.file)) {
            Ok(text) => mutant.problem(&text),
            Err(error) => Some(format!("{}: {}: {error}", mutant.name, mutant.file)),
        })
        .collect();
    assert!(problems.is_empty(), "mend tools/mutants/list.toml:\n{}", problems.join("\n"));
}

#[test]
fn names_are_unique_and_suites_are_there() {
    let list = list();
    let mut names = BTreeSet::new();
    for mutant in &list.mutant {
        assert!(names.insert(&mutant.name), "{} stands in the list twice", mutant.name);
        assert!(!mutant.suites.is_empty(), "{} has no suites", mutant.name);
        for suite in &mutant.suites {
            assert!(list.suite.contains_key(suite), "{}: no suite {suite}", mutant.name);
        }
    }
    for (name, suite) in &list.suite {
        assert!(list.mutant.iter().any(|mutant| mutant.suites.contains(name)), "nobody asks for {name}");
        assert!(!suite.package.is_empty() && !suite.target.is_empty(), "{name}");
        assert!(suite.tests.iter().all(|test| !test.is_empty()), "{name}");
    }
}

#[test]
fn an_entry_that_does_not_fit_is_found() {
    let mutant = |search: &str, replace: &str| Mutant {
        name: "m".to_owned(),
        file: "f".to_owned(),
        search: search.to_owned(),
        replace: replace.to_owned(),
        about: "a".to_owned(),
        suites: vec!["s".to_owned()],
        survives: None,
    };
    let text = "one two\none three\n";
    assert_eq!(mutant("two", "2").problem(text), None);
    assert!(mutant("one", "1").problem(text).is_some_and(|problem| problem.contains("2 times")));
    assert!(mutant("four", "4").problem(text).is_some_and(|problem| problem.contains("0 times")));
    assert!(mutant("two", "two").problem(text).is_some());
    assert!(mutant("two\none", "2").problem(text).is_some());
}
