//! A step that some rigs have taken and others have refused. Rigs that have taken it cannot go back, so it may be
//! repeated, and then the others take it.

/// Which rigs are through with a step that has failed in others.
#[derive(Debug, Default)]
pub struct HalfDone(Option<Step>);

#[derive(Debug)]
struct Step {
    t_ns: Vec<Option<i64>>,
    taken: Vec<bool>,
}

impl HalfDone {
    /// Whether a step at these times may be taken: any, or the one that has failed once more.
    pub fn allows(&self, t_ns: &[Option<i64>]) -> bool {
        self.0.as_ref().is_none_or(|step| step.t_ns == t_ns)
    }

    /// Whether every rig has taken the last step, or none.
    pub fn is_none(&self) -> bool {
        self.0.is_none()
    }

    /// Whether a rig has taken the step that is repeated.
    pub fn has_taken(&self, rig: usize) -> bool {
        self.0.as_ref().is_some_and(|step| step.taken[rig])
    }

    /// Notes how a step has ended in each rig. Fails with the first that has failed.
    pub fn note<E>(&mut self, t_ns: &[Option<i64>], results: Vec<Result<(), E>>) -> Result<(), E> {
        let taken: Vec<bool> = results.iter().map(Result::is_ok).collect();
        let result = results.into_iter().collect();
        let is_half = taken.contains(&true) && taken.contains(&false);
        self.0 = is_half.then(|| Step { t_ns: t_ns.to_vec(), taken });
        result
    }

    /// Forgets it: the rigs begin anew.
    pub fn clear(&mut self) {
        self.0 = None;
    }
}
