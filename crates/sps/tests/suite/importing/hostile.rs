//! Tables that would write where nobody asked, and names that properties can have.

use std::fs;
use std::path::Path;

use super::{FILES, Photographs};
use crate::support::cases;

/// Photographs with one more, `outside/a.png`, beside their folder.
fn beside_another(table: &str) -> Photographs {
    let photographs = Photographs::new(&FILES, table);
    let frame = Path::new("fixtures/tiny-dataset/frames/denim-01/002.png");
    photographs.add(frame, "../outside/a.png");
    photographs
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
        beside_another(&table.replace(r"\0", "\0")).is_refused("", parts);
    }
    let long = "x".repeat(201);
    let long = format!("surface,photograph,fRS\n{long},denim/b.png,1\n");
    beside_another(&long).is_refused("", "line 2; at most 200 bytes");
    let rows = beside_another("photograph,fRS\nb.png,1\n");
    rows.is_refused("--views ../outside", "lies outside of");
}

#[test]
fn an_absolute_path_is_accepted_inside_of_the_folder_alone() {
    let photographs = beside_another("");
    let table = |path: &str| {
        let path = photographs.0.path(path).display().to_string();
        let table = format!("photograph,fRS\n{path},1\n");
        photographs.0.write("values.csv", table);
    };
    table("outside/a.png");
    photographs.is_refused("", "line 2; lies outside of");
    table("photographs/denim/b.png");
    photographs.import("").assert().success();
    let surfaces = "surface,material,group\ndenim-b,unknown,denim-b\n";
    assert_eq!(photographs.text("surfaces.csv"), surfaces);
    assert!(photographs.has("denim-b/000.png", "denim-01/002.png"));
}

#[cfg(unix)]
#[test]
fn links_are_followed_inside_of_the_folder_alone() {
    use std::os::unix::fs::symlink;

    let photographs = beside_another("photograph,fRS\nlink.png,1\n");
    let link = photographs.0.path("photographs/link.png");
    symlink("../outside/a.png", &link).unwrap();
    photographs.is_refused("", "line 2; `link.png` lies outside of");
    fs::remove_file(&link).unwrap();
    symlink("denim/b.png", &link).unwrap();
    photographs.import("").assert().success();
    let copied = photographs.dataset().join("frames/link/000.png");
    assert!(fs::symlink_metadata(copied).unwrap().is_file());
}

/// Any column without a meaning of its own is a property.
#[test]
fn names_that_properties_can_have() {
    let table = "photograph,hardness,fRS,K-1,my_value\ndenim/b.png,1,2,3,4\noak/1.JPG,,-0.5,,5\n";
    let photographs = Photographs::new(&FILES, table);
    photographs.import("").assert().success();
    photographs.ensure_tables(
        "surface,material,group; denim-b,unknown,denim-b; oak-1,unknown,oak-1",
        "surface,location,repeat,hardness,fRS,K-1,my_value; denim-b,0,0,1,2,3,4; oak-1,0,0,,-0.5,,5",
    );
}
