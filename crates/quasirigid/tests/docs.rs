//! What the documentation names exists: files, stages, identifiers, materials. Prose goes stale silently, so it is read by a test.

use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::world::report::STAGES;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Endings by which a word in `code type` is known for a file.
const FILE_ENDINGS: [&str; 7] = [".rs", ".py", ".pyi", ".md", ".toml", ".lock", ".png"];

/// Folders of the repository by which a word in `code type` is known for a path.
const FOLDERS: [&str; 6] = ["crates/", "docs/", "python/", "benchmarks/", "examples/", ".ci/"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All pages: path from the root of the repository, and text. None where the crate lies apart from its repository.
fn pages() -> Vec<(PathBuf, String)> {
    if !root().join("docs/step.md").exists() {
        eprintln!("skipped: the crate lies apart from its repository, there are no pages to read");
        return Vec::new();
    }
    let mut paths: Vec<PathBuf> = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].iter().map(|name| root().join(name)).collect();
    for entry in std::fs::read_dir(root().join("docs")).expect("docs is a folder") {
        let path = entry.expect("a folder that can be listed").path();
        if path.extension().is_some_and(|ending| ending == "md") {
            paths.push(path);
        }
    }
    paths.sort();
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        (path.strip_prefix(root()).unwrap_or(&path).to_path_buf(), text)
    };
    paths.into_iter().map(read).collect()
}

/// Names of all files below a folder.
fn file_names(folder: &Path, names: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            file_names(&entry.path(), names);
        } else {
            names.insert(entry.file_name().to_string_lossy().into_owned());
        }
    }
}

fn page(name: &str) -> Option<String> {
    pages().into_iter().find(|(path, _)| path.ends_with(name)).map(|(_, text)| text)
}

/// What stands between `open` and `close`, with the number of its line. Neither reaches over the end of a line.
fn between<'a>(text: &'a str, open: &'a str, close: &'a str) -> impl Iterator<Item = (usize, &'a str)> {
    text.lines().enumerate().flat_map(move |(line, text)| {
        text.split(open).skip(1).filter_map(move |rest| rest.split_once(close)).map(move |(inner, _)| (line + 1, inner))
    })
}

/// Words in `code type`, outside code blocks.
fn code_words(text: &str) -> Vec<(usize, &str)> {
    let mut in_block = false;
    let mut words = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            in_block = !in_block;
        } else if !in_block {
            words.extend(line.split('`').skip(1).step_by(2).map(|word| (number + 1, word)));
        }
    }
    words
}

#[test]
fn every_link_leads_to_a_file_that_exists() {
    let mut broken = Vec::new();
    for (path, text) in pages() {
        for (line, target) in between(&text, "](", ")") {
            let file = target.split('#').next().unwrap_or_default();
            if !(target.contains("://") || file.is_empty() || root().join(path.with_file_name(file)).exists()) {
                broken.push(format!("{}:{line}: {target}", path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "links to nowhere:\n{}", broken.join("\n"));
}

#[test]
fn index_and_readme_lead_to_every_page() {
    for (list, folder) in [("docs/index.md", ""), ("README.md", "docs/")] {
        let Some(text) = page(list) else { return };
        for (path, _) in pages() {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let missing = path.starts_with("docs") && name != "index.md" && !text.contains(&format!("]({folder}{name})"));
            assert!(!missing, "{list} does not lead to {}", path.display());
        }
    }
}

#[test]
fn every_path_in_code_type_exists() {
    let mut missing = Vec::new();
    let mut names = BTreeSet::new();
    ["crates", "python"].iter().for_each(|folder| file_names(&root().join(folder), &mut names));
    for (path, text) in pages() {
        for (line, word) in code_words(&text) {
            let is_path = FOLDERS.iter().any(|folder| word.starts_with(folder)) || FILE_ENDINGS.iter().any(|ending| word.ends_with(ending));
            if !is_path || word.contains([' ', '*', '<']) {
                continue;
            }
            let places = [root().join(word), root().join("crates/quasirigid").join(word), root().join("crates/quasirigid/src").join(word)];
            // A bare name is that of a file anywhere in the source.
            if !(names.contains(word) || places.iter().any(|place| place.exists())) {
                missing.push(format!("{}:{line}: {word}", path.display()));
            }
        }
    }
    assert!(missing.is_empty(), "paths that do not exist:\n{}", missing.join("\n"));
}

#[test]
fn step_page_walks_the_stages_of_the_engine_in_order() {
    let Some(text) = page("docs/step.md") else { return };
    let headings: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("## ")?.split_once(". ")).map(|(_, name)| name).collect();
    assert_eq!(headings, STAGES);
    assert!(text.contains(&STAGES.join(" -> ")), "the line of all five stages");
}

#[test]
fn every_identifier_of_the_notation_table_is_in_the_source() {
    let Some(text) = page("docs/notation.md") else { return };
    let mut source = String::new();
    read_sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut source);
    let words: BTreeSet<&str> = source.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect();
    let mut unknown = Vec::new();
    for row in text.lines().filter(|line| line.starts_with('|')).skip(2) {
        let name_in_code = row.split('|').nth(2).unwrap_or_default();
        for (_, name) in code_words(name_in_code) {
            let parts = name.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|part| !part.is_empty());
            unknown.extend(parts.filter(|part| !words.contains(part)).map(|part| format!("{part} in {row}")));
        }
    }
    assert!(unknown.is_empty(), "names that the source does not have:\n{}", unknown.join("\n"));
}

fn read_sources(folder: &Path, all: &mut String) {
    for entry in std::fs::read_dir(folder).expect("a folder of the source") {
        let path = entry.expect("a folder that can be listed").path();
        if path.is_dir() {
            read_sources(&path, all);
        } else {
            all.push_str(&std::fs::read_to_string(&path).expect("a source file"));
        }
    }
}

/// The table that `docs/materials.md` must hold: regenerate it from the failure message.
fn materials_table() -> String {
    let row = |name: &str| {
        let m = Material::preset(name).expect("a name of the list");
        let ComplianceModel::Gaussian { foundation_modulus, .. } = m.model else { unreachable!("presets are Gaussian") };
        format!(
            "| `{name}` | {} | {} | {} | {} | {} | {} | {:.2e} |",
            m.density,
            m.friction.static_coefficient,
            round(m.young_modulus * 1e-6),
            m.poisson_ratio,
            round(m.layer_thickness * 1e3),
            round(m.relaxation_time * 1e3),
            foundation_modulus
        )
    };
    Material::preset_names().map(row).collect::<Vec<_>>().join("\n")
}

/// To six digits, so that 0.115e6 Pa reads 0.115 MPa.
fn round(x: f64) -> f64 {
    format!("{x:.6}").parse().unwrap_or(x)
}

#[test]
fn materials_page_has_the_figures_of_the_engine() {
    let Some(text) = page("docs/materials.md") else { return };
    // Cells are padded in the page.
    let cells = |line: &str| line.split('|').map(str::trim).collect::<Vec<_>>().join(" | ").trim().to_string();
    let table: Vec<String> = text.lines().filter(|line| line.starts_with("| `")).map(cells).collect();
    assert_eq!(table.join("\n"), materials_table(), "the table should be\n{}", materials_table());
}
