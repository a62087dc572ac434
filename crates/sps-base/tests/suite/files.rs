//! Files and folders are there whole or not at all, and nothing is left beside them.

use std::fs;
use std::io;
use std::path::Path;
use std::time::Duration;

use sps_base::files::{remove_unfinished, write_file, write_folder, write_new};

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn replaces_whole_files_and_leaves_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/er/a.json");
    write_file(&path, b"one").unwrap();
    write_file(&path, b"two").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"two");
    let folder = path.parent().unwrap();
    fs::create_dir_all(folder.join(".writing-7-0/b")).unwrap();
    fs::write(folder.join(".writing-a1b2"), b"half").unwrap();
    remove_unfinished(folder, Duration::from_secs(60)).unwrap();
    assert_eq!(names(folder).len(), 3);
    remove_unfinished(folder, Duration::ZERO).unwrap();
    assert_eq!(names(folder), ["a.json"]);
}

#[test]
fn what_a_killed_writer_left_is_not_in_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let left = format!(".writing-{}-0", std::process::id());
    fs::write(folder.path().join(&left), b"half").unwrap();
    write_file(&folder.path().join("a"), b"whole").unwrap();
    assert_eq!(fs::read(folder.path().join("a")).unwrap(), b"whole");
    assert_eq!(names(folder.path()), [left.as_str(), "a"]);
}

#[test]
fn a_folder_is_replaced_whole_or_left_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s");
    let write = |name: &'static str, then: io::Result<()>| {
        let fill = |partial: &Path| write_new(&partial.join(name), b"x").and(then);
        write_folder(&path, fill, |error| error)
    };
    write("a", Ok(())).unwrap();
    write("b", Err(io::ErrorKind::Other.into())).unwrap_err();
    assert_eq!(names(&path), ["a"]);
    write("b", Ok(())).unwrap();
    assert_eq!(names(&path), ["b"]);
    assert_eq!(names(folder.path()), ["s"]);
}

#[test]
fn a_path_without_a_name_or_through_a_file_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    write_file(&file, b"").unwrap();
    write_file(&file.join("a.json"), b"x").unwrap_err();
    write_file(&folder.path().join(".."), b"x").unwrap_err();
    assert_eq!(names(folder.path()), ["file"]);
}

/// A file that took the permissions of a temporary one could not be read by others.
#[cfg(unix)]
#[test]
fn permissions_are_those_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let [plain, ours] = ["plain", "ours"].map(|name| folder.path().join(name));
    fs::write(&plain, b"").unwrap();
    write_file(&ours, b"").unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(ours), mode(plain));
}

#[test]
fn threads_may_write_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::thread::scope(|scope| {
        for byte in 0..8 {
            let path = &path;
            scope.spawn(move || write_file(path, &[byte; 1000]).unwrap());
        }
    });
    let bytes = fs::read(&path).unwrap();
    assert_eq!(bytes, [bytes[0]; 1000]);
    assert_eq!(names(folder.path()), ["a"]);
}
