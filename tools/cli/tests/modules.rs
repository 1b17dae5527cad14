//! The program's modules do not depend on each other in circles.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The modules that each module of `src` uses. Files of a folder count as one module; unit tests do not count.
fn modules(folder: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let mut modules: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut folders = vec![(folder.to_owned(), None::<String>)];
    while let Some((folder, module)) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name =
                module.clone().unwrap_or_else(|| path.file_stem().unwrap().to_str().unwrap().to_owned());
            if path.is_dir() {
                folders.push((path, Some(name)));
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]").next().unwrap();
            let uses = modules.entry(name).or_default();
            for rest in text.split("crate::").skip(1) {
                let list = rest.strip_prefix('{').map_or(rest, |list| list.split('}').next().unwrap());
                let names = if list.len() < rest.len() { list.split(',').collect() } else { vec![rest] };
                let word = |name: &str| {
                    let name = name.trim();
                    name[..name.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(name.len())]
                        .to_owned()
                };
                uses.extend(names.into_iter().map(word).filter(|name| !name.is_empty()));
            }
        }
    }
    modules
}

/// Removes modules that use none of the others until there are no more; what is left has a circle.
fn circles(mut modules: BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    loop {
        let names: BTreeSet<String> = modules.keys().cloned().collect();
        let before = modules.len();
        modules.retain(|name, uses| uses.iter().any(|used| used != name && names.contains(used)));
        if modules.len() == before {
            return modules.into_keys().collect();
        }
    }
}

#[test]
fn the_modules_have_no_circles() {
    let modules = modules(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    assert!(modules["demo"].contains("arguments") && modules["serve"].contains("output_file"), "{modules:?}");
    assert_eq!(modules["arguments"], BTreeSet::new());
    assert_eq!(circles(modules), [""; 0]);
}

#[test]
fn a_circle_is_found() {
    let uses = |pairs: &[(&str, &str)]| {
        let mut modules: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (user, used) in pairs {
            modules.entry((*user).to_owned()).or_default().insert((*used).to_owned());
            modules.entry((*used).to_owned()).or_default();
        }
        modules
    };
    assert_eq!(circles(uses(&[("a", "b"), ("b", "c")])), [""; 0]);
    assert_eq!(circles(uses(&[("a", "b"), ("b", "c"), ("c", "b")])), ["a", "b", "c"]);
}
