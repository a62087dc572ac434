//! Tables that would write where nobody asked, and names that no property can have.

use std::fs;

use super::{FILES, Photographs};
use crate::support::{Ends, cases, tree};

/// Photographs with one more, `outside/a.png`, beside their folder.
fn beside_another(table: &str) -> Photographs {
    let photographs = Photographs::new(&FILES, table);
    photographs.add(
        "fixtures/tiny-dataset/frames/denim-01/002.png".as_ref(),
        "../outside/a.png",
    );
    photographs
}

fn refused(photographs: &Photographs, options: &str, parts: &[&str]) {
    let before = tree(&photographs.0.path("."));
    photographs.import_with(options).refused(parts);
    assert!(tree(&photographs.0.path(".")) == before, "{parts:?}");
}

/// As [`super::REFUSED`].
const HOSTILE: &str = r#"
class,fRS\n../outside,1\n | line 2; lies outside of
class,fRS\ndenim/../../outside,1\n | line 2; lies outside of
class,fRS\n/,1\n | line 2
class,fRS\ndenim/../oak,1\n | line 2; without slashes, colons and control characters
class,fRS\n.,1\n | line 2
class,fRS\nden\0im,1\n | line 2; den\0im
surface,fRS\n../outside,1\n | line 2; lies outside of
photograph,fRS\n../outside/a.png,1\n | line 2; lies outside of
photograph,fRS\ndenim/\0b.png,1\n | line 2; denim/\0b.png
surface,photograph,fRS\n../../x,denim/b.png,1\n | line 2; ../../x; begin with a dot
surface,photograph,fRS\nx/../../y,denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\n/x,denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\nx\y,denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\nC:x,denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\n"a\nb",denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\nx\0y,denim/b.png,1\n | line 2; without slashes, colons and control characters
surface,photograph,fRS\n..,denim/b.png,1\n | line 2; `..`
"#;

#[test]
fn hostile_tables_leave_nothing_behind() {
    for (table, parts) in cases(HOSTILE) {
        refused(&beside_another(&table.replace(r"\0", "\0")), "", &parts);
    }
    let long = "x".repeat(201);
    let long = format!("surface,photograph,fRS\n{long},denim/b.png,1\n");
    let bytes = ["line 2", "at most 200 bytes"];
    refused(&beside_another(&long), "", &bytes);
    let rows = beside_another("photograph,fRS\nb.png,1\n");
    refused(&rows, "--views ../outside", &["lies outside of"]);
}

#[test]
fn an_absolute_path_is_accepted_inside_of_the_folder_alone() {
    let photographs = beside_another("");
    let table = |path: &str| {
        let path = photographs.0.path(path);
        let table = format!("photograph,fRS\n{},1\n", path.display());
        photographs.0.write("values.csv", table);
    };
    table("outside/a.png");
    refused(&photographs, "", &["line 2", "lies outside of"]);
    table("photographs/denim/b.png");
    photographs.import().assert().success();
    let surfaces = "surface,material,group\ndenim-b,unknown,denim-b\n";
    assert_eq!(photographs.text("surfaces.csv"), surfaces);
    let copied = photographs.dataset().join("frames/denim-b/000.png");
    assert!(copied.is_file());
}

#[cfg(unix)]
#[test]
fn links_are_followed_inside_of_the_folder_alone() {
    use std::os::unix::fs::symlink;

    let photographs = beside_another("photograph,fRS\nlink.png,1\n");
    let link = photographs.0.path("photographs/link.png");
    symlink("../outside/a.png", &link).unwrap();
    refused(&photographs, "", &["line 2", "`link.png` lies outside of"]);
    fs::remove_file(&link).unwrap();
    symlink("denim/b.png", &link).unwrap();
    photographs.import().assert().success();
    let copied = photographs.dataset().join("frames/link/000.png");
    assert!(fs::symlink_metadata(copied).unwrap().is_file());
}

/// As [`super::REFUSED`], of headers.
const NO_NAMES: &str = "
photograph,location | `location`; a meaning of its own
photograph,Repeat | `Repeat`; rename it
photograph,Surface | `Surface`; `surface`
photograph,Group | `Group`; `group`
photograph,view | `photograph`, `view`; these two with `view`
class,photograph | `class`, `photograph`
surface,view | `surface`, `view`
photograph,a/b | `a/b`
photograph,../x | `../x`
photograph,Härte | `Härte`
photograph,硬度 | `硬度`
photograph, | values.csv
";

#[test]
fn names_that_no_property_can_have() {
    for (header, parts) in cases(NO_NAMES) {
        let table = format!("{header}\ndenim/b.png,1\n");
        refused(&Photographs::new(&FILES, &table), "", &parts);
    }
}

/// Any other column is a property.
#[test]
fn names_that_properties_can_have() {
    let table = "photograph,hardness,fRS,K-1,my_value\ndenim/b.png,1,2,3,4\noak/1.JPG,,-0.5,,5\n";
    let photographs = Photographs::new(&FILES, table);
    photographs.import().assert().success();
    photographs.ensure_tables(
        "surface,material,group; denim-b,unknown,denim-b; oak-1,unknown,oak-1",
        "surface,location,repeat,hardness,fRS,K-1,my_value; denim-b,0,0,1,2,3,4; oak-1,0,0,,-0.5,,5",
    );
    for (name, code) in [("color vibrancy", "`color-vibrancy`"), ("a/b", "`a-b`")] {
        let table = format!("photograph,{name}\ndenim/b.png,1\n");
        let said = [&*format!("`{name}`"), code];
        refused(&Photographs::new(&FILES, &table), "", &said);
    }
}
