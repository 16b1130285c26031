//! How a job begins, anew or with what another run left of it, and what it leaves when it fails.

use std::path::Path;

use super::{
    End, Job, Keeping, Method, Start, Task,
    fingerprint::{fingerprint, is_exclusive, key},
};
use crate::{
    error::{Error, Result},
    formats::Declared,
    soup::{Input, OpenInput},
    stages::convert::import,
    storage::{Condition, Fingerprint, Left, Workspace, find_left},
};

/// What the inputs said of themselves, if some of them cannot be asked again.
const INPUTS: &str = "inputs";
/// The method that was chosen.
const METHOD: &str = "method";

/// A job with a journal, about to be prepared.
pub(super) struct Beginning {
    keeping: Keeping,
    print: Fingerprint,
    key: String,
    /// Of a run before this one.
    workspace: Option<Workspace>,
    /// What a person should know.
    pub(super) notes: Vec<String>,
}

impl Beginning {
    /// Looks for what other runs have left of `job`, and takes it over if that is asked for; `None`
    /// where the job keeps nothing.
    pub(super) fn of(job: &Job) -> Result<Option<Self>> {
        let Some(keeping) = job.keeping else { return Ok(None) };
        let print = fingerprint(job)?;
        let key = key(job, &print);
        let mut beginning = Self { keeping, key, print, workspace: None, notes: Vec::new() };
        let mut resumable = Vec::new();
        let found = match (find_left(&job.temp_dir, &beginning.key), keeping.start) {
            // A folder that cannot be listed can still be worked in.
            (Err(_), Start::Anew) => Vec::new(),
            (found, _) => found?,
        };
        for left in found {
            match left.condition {
                Condition::InUse if is_exclusive(job) => {
                    let (output, path) = (job.target.path().display(), left.path.display());
                    let text =
                        format!("{output} is being made by another run, which works in {path}");
                    return Err(Error::Request(text));
                }
                Condition::Useless(..) if keeping.start == Start::Resume => left.remove_if_old()?,
                Condition::InUse | Condition::Useless(..) => {}
                Condition::Resumable(..) => resumable.push(left),
            }
        }
        match keeping.start {
            Start::Anew => resumable.iter().for_each(|left| beginning.say_left(left)),
            Start::Resume => beginning.resume(job, resumable)?,
        }
        Ok(Some(beginning))
    }

    fn say_left(&mut self, left: &Left) {
        self.notes.push(format!(
            "a run for this output that did not end has left {} in {}, and --resume goes on from it",
            bytesize::ByteSize(left.size_bytes),
            left.path.display()
        ));
    }

    /// Goes on from one of `resumable`, if it is of this job as it is now.
    fn resume(&mut self, job: &Job, resumable: Vec<Left>) -> Result<()> {
        let mut other = None;
        for left in resumable {
            let Condition::Resumable(manifest, _) = &left.condition else { continue };
            let differences = manifest.differences(&self.print);
            if !differences.is_empty() {
                other = other.or(Some((left.path.display().to_string(), differences)));
                continue;
            }
            if self.workspace.is_some() {
                self.say_left(&left);
                continue;
            }
            let Some((workspace, damaged)) = left.take_over(self.keeping.interval)? else {
                continue;
            };
            if !damaged.is_empty() {
                let damaged = damaged.join(", ");
                self.notes.push(format!("damaged, and done again: {damaged}"));
            }
            let is_gone = job.inputs.iter().any(|path| !Input::is_repeatable_path(path));
            if is_gone && !(workspace.is_noted(import::STEP) && workspace.is_noted(INPUTS)) {
                // What was read of a stream is not all here, and cannot be read again.
                drop(workspace.to_be_removed());
                continue;
            }
            self.workspace = Some(workspace);
        }
        if let Some(workspace) = &self.workspace {
            let done =
                workspace.noted().into_iter().filter(|step| step != METHOD && step != INPUTS);
            let (path, done) = (workspace.path().display(), done.collect::<Vec<_>>().join(", "));
            self.notes.push(format!("going on from {path}: {done}"));
            return Ok(());
        }
        if let Some((path, differences)) = other {
            let text = format!(
                "what lies in {path} is of another job and cannot be resumed: {} changed",
                differences.join(", ")
            );
            return Err(Error::Request(text));
        }
        self.notes.push("nothing to resume: starting from the start".to_owned());
        Ok(())
    }

    /// Opens an input; one that cannot be read again and was set aside is not.
    pub(super) fn open(&self, input: &Input, index: usize) -> Result<OpenInput> {
        let recalled = self.workspace.as_ref().filter(|_| !input.is_repeatable());
        let recalled = recalled.and_then(|workspace| workspace.recall::<Vec<Declared>>(INPUTS));
        match recalled.and_then(|mut recalled| recalled.figures.get_mut(index).cloned()) {
            Some(declared) => Ok(OpenInput::set_aside(input.clone(), declared)),
            None => input.open(),
        }
    }

    /// The method that the run before this one has chosen.
    pub(super) fn method(&self) -> Option<Method> {
        let name = self.workspace.as_ref()?.recall::<String>(METHOD)?.figures;
        Method::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Bytes on disk that the job has already.
    pub(super) fn held_bytes(&self) -> u64 {
        self.workspace.as_ref().map_or(0, Workspace::disk_bytes)
    }

    /// The workspace to do the job in.
    pub(super) fn workspace(self, temp_dir: &Path) -> Result<Workspace> {
        match self.workspace {
            Some(workspace) => Ok(workspace),
            None => Ok(Workspace::create_for(temp_dir, &self.key)?
                .with_journal(self.print, self.keeping.interval)),
        }
    }
}

/// Notes what a run that goes on has to know before anything else.
pub(super) fn note_start(job: &Job, inputs: &[OpenInput], workspace: &Workspace) -> Result<()> {
    if inputs.iter().any(|open| !open.input.is_repeatable()) {
        // Nobody asks for the bounds once the input has been read.
        let declared =
            |open: &OpenInput| Declared { bounds: None, ..open.reader.declared().clone() };
        let declared: Vec<Declared> = inputs.iter().map(declared).collect();
        workspace.note(INPUTS, &declared, Vec::new())?;
    }
    note_method(job, workspace)
}

/// Notes the method, once it is chosen: what is left to memory is to be the same with another.
pub(super) fn note_method(job: &Job, workspace: &Workspace) -> Result<()> {
    match &job.task {
        Task::Simplify(simplify) if simplify.method != Method::Auto => {
            workspace.note(METHOD, &simplify.method.name(), Vec::new())
        }
        _ => Ok(()),
    }
}

/// Ends the use of a workspace: removes it, or leaves what can be gone on from.
pub(super) fn settle<T>(workspace: Workspace, job: &Job, result: Result<T>) -> Result<T> {
    let error = match result {
        Ok(value) => {
            if job.keeping.is_some_and(|keeping| keeping.end == End::Keep) {
                workspace.save_noted()?;
                drop(workspace.keep());
            } else {
                drop(workspace.to_be_removed());
            }
            return Ok(value);
        }
        Err(error) => error,
    };
    if let Error::Damaged { path, .. } = &error {
        workspace.forget_file(path);
    }
    if !is_worth_another_try(&error) || !is_worth_keeping(job, &workspace) {
        drop(workspace.to_be_removed());
        return Err(error);
    }
    Err(match workspace.leave() {
        Some((workspace, size_bytes)) => {
            Error::Unfinished { error: Box::new(error), workspace, size_bytes }
        }
        None => error,
    })
}

/// Whether a run could go on from what is noted, and would gain by it.
fn is_worth_keeping(job: &Job, workspace: &Workspace) -> bool {
    let is_done = |step: &String| step != METHOD && step != INPUTS;
    let is_there = job.inputs.iter().all(Input::is_repeatable_path);
    (is_there || workspace.is_noted(import::STEP)) && workspace.noted().iter().any(is_done)
}

/// Whether the same job might be done another time.
fn is_worth_another_try(error: &Error) -> bool {
    match error {
        Error::Io { source, .. } => source.kind() != std::io::ErrorKind::BrokenPipe,
        Error::Damaged { .. } | Error::Resource { .. } | Error::Cancelled(_) => true,
        _ => false,
    }
}
