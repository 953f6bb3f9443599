//! Scenes: steps that are carried out one after the other, up to the first failure.

use super::batch::{BatchDone, BatchTerms, Part, parts_of};
use super::context::Context;
use crate::config::{Config, Place, Scene, Step};
use crate::rights::Who;
use crate::{CommandError, WriteTerms};
use railbus_wire::Micros;

/// A running scene. It ends when this is dropped.
struct Playing {
    context: Context,
    scene: String,
}

impl Drop for Playing {
    fn drop(&mut self) {
        self.context.with(|state| state.playing.remove(&self.scene));
    }
}

/// Outputs of one module that follow each other in a scene and go the same way.
struct Run {
    module: String,
    outputs: Vec<Place>,
    on: bool,
}

impl Context {
    /// Runs a scene: its steps in order, consecutive ones for one module and state with one
    /// command. After a step that fails, nothing more is done: later steps may rely on it.
    pub(crate) async fn play(
        &self,
        who: &Who,
        scene: &str,
        terms: BatchTerms,
    ) -> Result<BatchDone, CommandError> {
        let since = self.config();
        let known: Option<&Scene> = since.scenes.get(scene);
        let steps = &known.ok_or(CommandError::NoSuchScene)?.steps;
        if !self.with(|state| state.playing.insert(scene.to_owned())) {
            return Err(CommandError::Playing);
        }
        let _playing = Playing {
            context: self.clone(),
            scene: scene.to_owned(),
        };
        let mut done = BatchDone::default();
        let mut going = true;
        let mut rest = steps.iter().peekable();
        while let Some(step) = rest.next() {
            match step {
                Step::Wait(time) if going => {
                    going = self.wait_in_scene(*time).await;
                }
                Step::Wait(_) => {}
                Step::Set(place, on) => {
                    let mut run = Run {
                        module: place.module.clone(),
                        outputs: vec![place.clone()],
                        on: *on,
                    };
                    while let Some(Step::Set(next, _)) = rest.next_if(|step| continues(&run, step))
                    {
                        run.outputs.push(next.clone());
                    }
                    let parts = self
                        .play_run(&since, who, run, going.then_some(terms))
                        .await;
                    going = going && parts.iter().all(|part| part.end.is_ok());
                    done.parts.extend(parts);
                }
            }
        }
        Ok(done)
    }

    /// Says whether the site is not being closed.
    async fn wait_in_scene(&self, time: Micros) -> bool {
        let until = self.now() + time;
        self.until(until, self.stopping()).await.is_none()
    }

    /// One command, at the board that had the name when the scene began; none where an earlier one
    /// has failed.
    async fn play_run(
        &self,
        since: &Config,
        who: &Who,
        run: Run,
        terms: Option<BatchTerms>,
    ) -> Vec<Part> {
        let Run {
            module,
            outputs,
            on,
        } = run;
        let set: Vec<_> = outputs.iter().map(|place| (place.point, on)).collect();
        let end = match terms {
            Some(BatchTerms {
                verify,
                confirm,
                within,
                ..
            }) => {
                let terms = WriteTerms {
                    verify,
                    confirm,
                    ..WriteTerms::default()
                };
                let terms = (terms, self.expires(within));
                self.write_since(since, who, &module, &set, terms).await
            }
            None => Err(CommandError::NotTried),
        };
        let ends: Vec<_> = match end {
            Ok(done) => parts_of(&done).into_iter().map(Ok).collect(),
            Err(failure) => outputs.iter().map(|_| Err(failure.clone())).collect(),
        };
        let parts = outputs.into_iter().zip(ends);
        parts
            .map(|(place, end)| Part {
                place,
                wanted: on,
                end,
            })
            .collect()
    }
}

fn continues(run: &Run, step: &Step) -> bool {
    let Step::Set(place, on) = step else {
        return false;
    };
    (&place.module, *on) == (&run.module, run.on) && !run.outputs.contains(place)
}
