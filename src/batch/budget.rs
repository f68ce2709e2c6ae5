//! How many files are worked on at the same time: so many, and as many as fit into memory together.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// What may be in use at the same time. The one thread that hands out work waits for it, never one that
/// does the work: a worker that waited while it holds a share of its own could wait for itself.
pub struct Budget {
    free: Mutex<Free>,
    freed: Condvar,
    bytes: u64,
}

struct Free {
    files: usize,
    bytes: u64,
}

/// A part of the budget, in use until it is dropped.
pub struct Share<'b> {
    budget: &'b Budget,
    bytes: u64,
}

impl Budget {
    pub fn new(files: usize, bytes: u64) -> Self {
        Self { free: Mutex::new(Free { files, bytes }), freed: Condvar::new(), bytes }
    }

    /// Waits until one more file that needs `bytes` fits. One that needs more than there is gets all.
    pub fn take(&self, bytes: u64) -> Share<'_> {
        let bytes = bytes.min(self.bytes);
        let is_short = |free: &mut Free| free.files == 0 || free.bytes < bytes;
        let mut free = self.freed.wait_while(self.lock(), is_short).unwrap_or_else(PoisonError::into_inner);
        free.files -= 1;
        free.bytes -= bytes;
        Share { budget: self, bytes }
    }

    fn lock(&self) -> MutexGuard<'_, Free> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        let mut free = self.budget.lock();
        free.files += 1;
        free.bytes += self.bytes;
        self.budget.freed.notify_all();
    }
}

/// Half of the memory of the machine, or of the part of it that this process may use; 2 GB where the
/// system does not say.
pub fn half_of_memory() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let group = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    match system.total_memory().min(group) {
        0 => 2_000_000_000,
        bytes => bytes / 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Duration;

    /// Whether `take(bytes)` has to wait until `share` is dropped.
    fn waits_for(budget: &Budget, bytes: u64, share: Share) -> bool {
        let (sender, receiver) = mpsc::channel();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let _taken = budget.take(bytes);
                sender.send(()).unwrap();
            });
            let came = receiver.recv_timeout(Duration::from_millis(100)).is_ok();
            drop(share);
            if !came {
                receiver.recv_timeout(Duration::from_secs(60)).unwrap();
            }
            !came
        })
    }

    #[test]
    fn files_that_do_not_fit_together_wait_for_each_other() {
        let budget = Budget::new(9, 100);
        assert!(!waits_for(&budget, 40, budget.take(60)));
        assert!(waits_for(&budget, 41, budget.take(60)));
        assert!(!waits_for(&budget, 0, budget.take(100)));
    }

    #[test]
    fn one_larger_than_all_runs_alone() {
        let budget = Budget::new(9, 100);
        assert!(waits_for(&budget, u64::MAX, budget.take(1)));
        assert!(waits_for(&budget, 1, budget.take(u64::MAX)));
    }

    #[test]
    fn there_are_no_more_files_than_allowed() {
        let budget = Budget::new(2, 100);
        let _first = budget.take(0);
        assert!(waits_for(&budget, 0, budget.take(0)));
        assert_eq!(budget.lock().files, 1);
        assert_eq!(budget.lock().bytes, 100);
    }

    #[test]
    fn the_machine_has_memory() {
        assert!(half_of_memory() > 100_000_000);
    }
}
