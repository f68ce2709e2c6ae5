//! Temporary files: each stands beside the file whose name it takes in the end.
//!
//! A process that is killed leaves its temporary file behind. Whoever writes one holds a lock on it, and
//! the system drops the locks of the dead, so that a later run can tell what is left over from what
//! another process is about to finish.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

use tempfile::NamedTempFile;

const PREFIX: &str = ".sharpen-";
const SUFFIX: &str = ".tmp";

/// Makes a temporary file in `folder`, with the permissions of any new file.
pub(super) fn create(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    loop {
        let temporary = builder.tempfile_in(folder)?;
        // Between its creation and the lock somebody may have taken it for a left-over. Where there are
        // no locks, nobody can.
        let is_taken = matches!(temporary.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if !is_taken && temporary.path().exists() {
            return Ok(temporary);
        }
    }
}

/// Removes the temporary files in `folder` that killed processes have left behind, and returns how many
/// there were. Those of living processes stay; folders in it are not entered.
pub fn remove_left_over(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let is_file = |entry: &fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_file());
    let ours = entries.flatten().filter(|entry| is_ours(&entry.file_name()) && is_file(entry));
    // The lock is held until the file is gone.
    let remove = |path: &Path| {
        let Ok(file) = File::open(path) else { return false };
        file.try_lock().is_ok() && fs::remove_file(path).is_ok()
    };
    ours.filter(|entry| remove(&entry.path())).count()
}

/// Whether a file of this name is one of our temporary files.
#[must_use]
pub fn is_ours(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(PREFIX.as_bytes()) && name.ends_with(SUFFIX.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_over_is_removed_and_what_is_in_use_stays() {
        let folder = tempfile::tempdir().unwrap();
        let name = |name: &str| folder.path().join(name);
        for left in [".sharpen-abc.tmp", ".sharpen-state.jsonl", "sharpen-abc.tmp", "a.obj"] {
            fs::write(name(left), "").unwrap();
        }
        fs::create_dir(name(".sharpen-folder.tmp")).unwrap();
        let in_use = create(folder.path()).unwrap();
        assert_eq!(remove_left_over(folder.path()), 1);
        assert!(!name(".sharpen-abc.tmp").exists() && in_use.path().exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5);
        let path = in_use.path().to_owned();
        drop(in_use.keep().unwrap());
        assert_eq!(remove_left_over(folder.path()), 1);
        assert!(!path.exists());
        assert_eq!(remove_left_over(&name("none")), 0);
    }

    #[test]
    fn many_can_create_while_others_tidy_up() {
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for i in 0..2 {
                let folder = folder.path();
                scope.spawn(move || (0..500).map(|_| remove_left_over(folder)).sum::<usize>());
                scope.spawn(move || {
                    for j in 0..500 {
                        create(folder).unwrap().persist(folder.join(format!("{i}-{j}"))).unwrap();
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1000);
    }
}
