//! The docstrings of the compiled module, so that `help()` says what editors read in the stubs.
//!
//! They are written once, in `python/quasirigid/_quasirigid.pyi`. This makes a macro of them: `doc!("Surface.box")` is the text there.
//! The file is laid out by `ruff format`, so that lines and indents tell what a parser would. Whether all of it arrives is tested in
//! Python.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::{env, fs, io};

const STUBS: &str = "../../python/quasirigid/_quasirigid.pyi";

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed={STUBS}");
    println!("cargo::rerun-if-changed=build.rs");
    let stubs = fs::read_to_string(STUBS).map_err(|error| io::Error::new(error.kind(), format!("{STUBS}: {error}")))?;
    let mut code = String::from("macro_rules! doc {\n");
    for (name, text) in docstrings(&stubs) {
        writeln!(code, "    ({name:?}) => {{ {text:?} }};").map_err(io::Error::other)?;
    }
    code += "}\n";
    let folder = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set: cargo runs this"))?;
    fs::write(Path::new(&folder).join("docs.rs"), code)
}

/// Docstrings by name: `Surface`, `Surface.box`. What a constructor takes, and what class attributes are, is said behind what the class is.
fn docstrings(stubs: &str) -> BTreeMap<String, String> {
    let mut found: BTreeMap<String, String> = BTreeMap::new();
    let (mut class, mut owner) = (String::new(), String::new());
    let mut lines = stubs.lines();
    while let Some(line) = lines.next() {
        let code = line.trim_start();
        let indent = line.len() - code.len();
        if let Some(name) = code.strip_prefix("class ") {
            class = identifier(name).to_owned();
            owner = class.clone();
        } else if let Some(name) = code.strip_prefix("def ") {
            let scope = if indent == 0 { "" } else { &class };
            owner = [scope, identifier(name)].iter().filter(|part| !part.is_empty()).copied().collect::<Vec<_>>().join(".");
        } else if let Some(begin) = code.strip_prefix("\"\"\"") {
            let text = whole(begin, indent, &mut lines);
            if owner.is_empty() {
                continue; // what the file says of itself
            }
            let name = owner.strip_suffix(".__init__").unwrap_or(&owner).to_owned();
            let entry = found.entry(name).or_default();
            let gap = if entry.is_empty() { "" } else { "\n\n" };
            *entry += gap;
            *entry += &text;
        }
    }
    found
}

fn identifier(code: &str) -> &str {
    code.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()
}

/// A docstring from behind its opening quotes to the closing ones, without its indent.
fn whole<'a>(begin: &'a str, indent: usize, lines: &mut impl Iterator<Item = &'a str>) -> String {
    if let Some((text, _)) = begin.split_once("\"\"\"") {
        return text.to_owned();
    }
    let mut text = begin.to_owned();
    for line in lines {
        let line = line.get(indent..).unwrap_or_default();
        text.push('\n');
        if let Some((last, _)) = line.split_once("\"\"\"") {
            text += last;
            break;
        }
        text += line;
    }
    text.trim_end().to_owned()
}
