//! One file in a process of its own.
//!
//! A thread cannot be stopped from outside, whatever it does; a process can. With `--timeout` the program
//! calls itself for each file, with the same arguments behind the names of the file, and kills the process
//! that takes too long. What the file does to it, an abort included, stays in it. Should the parent be killed,
//! the child notices that its standard input ends, and ends as well.

use std::env;
use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::iter;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use super::plan::Task;

/// How a child ended.
#[derive(Debug)]
pub enum End {
    /// By itself, with this text.
    Itself(ExitStatus, String),
    /// By us, after its time.
    Killed,
}

/// The first word of a call for one file of a folder; input and output follow, then all words of the call
/// for the folder.
const ONLY_FILE: &str = "--only-file";

/// The call for one file of a folder.
///
/// # Errors
/// When the program cannot be found any more.
pub fn call(task: &Task) -> io::Result<Command> {
    let mut command = Command::new(env::current_exe()?);
    command.arg(ONLY_FILE).args([&task.input, &task.output]).args(env::args_os().skip(1));
    Ok(command)
}

/// What this process was called for, if for one file of a folder: input, output, and all words of the
/// call for the folder.
pub fn called() -> Option<(PathBuf, PathBuf, Vec<OsString>)> {
    let mut words = env::args_os();
    let program = words.next()?;
    if words.next()? != ONLY_FILE {
        return None;
    }
    let [input, output] = [words.next()?, words.next()?].map(PathBuf::from);
    Some((input, output, iter::once(program).chain(words).collect()))
}

/// Runs a command for no longer than `timeout`, and returns all that it printed.
///
/// # Errors
/// When it cannot be started.
pub fn run(mut command: Command, timeout: Duration) -> io::Result<End> {
    let (mut reader, writer) = io::pipe()?;
    let mut child = command.stdin(Stdio::piped()).stdout(writer.try_clone()?).stderr(writer).spawn()?;
    drop(command); // It holds our ends for writing.
    let (sender, receiver) = mpsc::channel();
    let reading = thread::Builder::new().spawn(move || {
        let mut text = Vec::new();
        let _ = reader.read_to_end(&mut text);
        let _ = sender.send(text);
    });
    if let Err(error) = reading {
        kill(&mut child);
        return Err(error);
    }
    match receiver.recv_timeout(timeout) {
        Ok(text) => Ok(End::Itself(child.wait()?, String::from_utf8_lossy(&text).into_owned())),
        Err(RecvTimeoutError::Disconnected) => Ok(End::Itself(child.wait()?, String::new())),
        Err(RecvTimeoutError::Timeout) => {
            kill(&mut child);
            Ok(End::Killed)
        }
    }
}

/// Ends a child, which may have ended already.
fn kill(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Makes this process end with the one that has called it.
///
/// # Errors
/// When there can be no more threads.
pub fn end_with_parent() -> io::Result<()> {
    thread::Builder::new().spawn(|| {
        let _ = io::copy(&mut io::stdin(), &mut io::sink());
        std::process::exit(1);
    })?;
    Ok(())
}

/// Prints the line that the parent waits for.
///
/// # Errors
/// When the parent is gone.
pub fn answer(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::time::Instant;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn all_that_a_child_prints_comes_back() {
        let end = run(shell("echo a; echo b >&2; exit 3"), Duration::from_secs(60)).unwrap();
        assert!(matches!(&end, End::Itself(status, text) if status.code() == Some(3) && text == "a\nb\n"));
        let end = run(shell("kill -9 $$"), Duration::from_secs(60)).unwrap();
        assert!(matches!(&end, End::Itself(status, _) if status.to_string().contains("signal: 9")));
        let much = run(shell("yes 12345678 | head -c 1000000"), Duration::from_secs(60)).unwrap();
        assert!(matches!(&much, End::Itself(_, text) if text.len() == 1_000_000));
    }

    #[test]
    fn a_child_that_hangs_is_killed_also_when_it_is_stopped() {
        let start = Instant::now();
        for script in ["exec sleep 60", "kill -STOP $$", "trap '' TERM; while :; do :; done"] {
            assert!(matches!(run(shell(script), Duration::from_millis(50)).unwrap(), End::Killed));
        }
        assert!(start.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn what_cannot_be_started_is_an_error() {
        assert!(run(Command::new("/no/such/program"), Duration::from_secs(1)).is_err());
    }
}
