"""The native vector environment: all lanes of a task in one call of the simulator.

It has each of gymnasium's three kinds of autoreset.
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, count, require
from impact_env.envs.shells import (
    METADATA,
    Info,
    Observation,
    TaskEnv,
    TaskSpec,
    add_tables,
    check_actions,
    check_options,
    check_render_mode,
    check_seed,
    costs_as_rewards,
    make_screen,
    observation_space,
    reward_space,
)
from impact_env.extras import optional

with optional():
    from gymnasium.error import ResetNeeded
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space


def read_autoreset_mode(mode: Any) -> AutoresetMode:
    """Return gymnasium's autoreset mode.

    ``mode`` is a mode, its name ("SAME_STEP") or its value ("SameStep").
    """
    for known in AutoresetMode:
        if mode in (known, known.name, known.value):
            return known
    allowed = ", ".join(known.name for known in AutoresetMode)
    raise ParameterError(
        f"autoreset_mode = {mode!r} is not allowed: one of {allowed}, as text or as "
        "gymnasium's enum"
    )


class TaskVectorEnv(VectorEnv[Observation, Any, NDArray[Any]]):
    """All lanes of a task in one call.

    Lane i behaves as the single environment with seed + i.

    Parameters
    ----------
    num_envs : int
        Number of lanes.
    render_mode : str or None
        As in the single environment.
    autoreset_mode : AutoresetMode or str
        When a lane whose episode has ended starts again: in the same step; in the next step, whose
        action it ignores; or only by `reset` with a ``reset_mask``. As gymnasium's enum, or as its
        name or value.
    max_episode_steps : int or None
        Number of steps after which episodes are truncated, as by gymnasium's TimeLimit around a
        single environment. None or -1: only the task's own budget.
    vector_reward : bool
        Whether rewards are minus the vector of costs.
    **arguments
        Arguments of the task, from which ``kind`` creates it.
    """

    metadata: dict[str, Any] = {**METADATA, "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as gymnasium declares it
    kind: TaskSpec

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        max_episode_steps: int | None = None,
        vector_reward: bool = False,
        **arguments: Any,
    ) -> None:
        check_render_mode(render_mode)
        self.autoreset_mode = read_autoreset_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        task = self.kind.make(count("num_envs", num_envs, 1), arguments)
        action_space = self.kind.action_space()
        task.limit = (
            None
            if max_episode_steps in (None, -1)
            else count("max_episode_steps", max_episode_steps, 1)
        )
        self.task = task
        self.render_mode = render_mode
        self.num_envs = task.lanes.count
        self.reward_space = reward_space(task, vector_reward)
        self.single_action_space = action_space
        self.single_observation_space = observation_space(task)
        self.action_space = batch_space(action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._observations: Observation | None = None
        self._over, self._rest = (
            np.zeros(self.num_envs, dtype=np.bool_),
            np.zeros(self.num_envs, dtype=np.bool_),
        )
        self._rests = False  # whether any lane does
        self._all = np.ones(self.num_envs, dtype=np.bool_)
        self._screen: Any = None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The lanes' random generators."""
        self._seed([None] * self.num_envs, np.ones(self.num_envs, dtype=np.bool_))
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The lanes' seeds."""
        self._seed([None] * self.num_envs, np.ones(self.num_envs, dtype=np.bool_))
        return tuple(self._seeds)

    def _seed(self, seeds: Sequence[int | None], which: NDArray[np.bool_]) -> None:
        """Create new generators for the lanes of a mask for which a seed is given.

        If no lane has a generator yet, all lanes get one.
        """
        if not self._generators:
            made = [
                seeding.np_random(seed if wanted else None)
                for seed, wanted in zip(seeds, which, strict=True)
            ]
            self._generators = [m[0] for m in made]
            self._seeds = [m[1] for m in made]
            return
        for lane in np.flatnonzero(which).tolist():
            if seeds[lane] is not None:
                self._generators[lane], self._seeds[lane] = seeding.np_random(seeds[lane])

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, Info]:
        """Start episodes at rest in all lanes, or in those of a mask.

        ``seed`` is a number from which lane i gets seed + i, or a sequence of a seed or None for
        each lane. ``options["reset_mask"]`` (num_envs,) is the mask, of bool. Other ``options`` set
        quantities that would be drawn, by the names in the task's ``options``: one number for all
        lanes, or an array of one for each lane. Returns observations (num_envs, features) and info.
        """
        chosen = check_options(options, ("reset_mask", *self.task.options))
        mask = chosen.pop("reset_mask", None)
        which = np.ones(self.num_envs, dtype=np.bool_) if mask is None else self._checked_mask(mask)
        self._seed(self._lane_seeds(seed), which)
        observations = self.task.reset(which, self._generators, chosen)
        if self._observations is not None:
            observations[~which] = self._observations[~which]
        self._observations = observations
        self._over[which] = self._rest[which] = False
        self._rests = bool(self._rest.any())
        return observations.copy(), self._masked(self.task.info(), which)

    def _lane_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
            require(
                len(seed) == self.num_envs,
                "seed",
                seed,
                f"a whole number, or a list of {self.num_envs}",
            )
            return [check_seed(value) for value in seed]
        first = count("seed", seed, 0)
        return [first + i for i in range(self.num_envs)]

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        ok = (
            isinstance(mask, np.ndarray)
            and mask.dtype == np.bool_
            and mask.shape == (self.num_envs,)
            and bool(mask.any())
        )
        require(
            ok,
            "reset_mask",
            mask,
            f"a bool array of shape ({self.num_envs},) with at least one True",
        )
        if self._observations is None and not mask.all():
            raise ResetNeeded("the first reset() must be one of all lanes: leave reset_mask out")
        return np.asarray(mask)

    def rest(self, mask: NDArray[np.bool_]) -> None:
        """Exclude the lanes of a mask (num_envs,) of bool until they are reset; include all others.

        An excluded lane takes almost no time: it ignores its action, has reward 0, does not end,
        and repeats its last observation.
        """
        ok = (
            isinstance(mask, np.ndarray)
            and mask.dtype == np.bool_
            and mask.shape == (self.num_envs,)
        )
        require(ok, "mask", mask, f"a bool array of shape ({self.num_envs},)")
        self._rest = mask.copy()
        self._rests = bool(mask.any())

    def step(
        self, actions: Any
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], Info]:
        """Advance all lanes by one control interval.

        With autoreset in the same step, lanes that ended start again at once; their last
        observation and info are in ``final_obs``, ``final_info`` of info, with the masks
        ``_final_obs``, ``_final_info``. With autoreset in the next step, lanes that ended in the
        last one start again instead of acting, with reward 0. Without autoreset they must have been
        reset: raises ResetNeeded.

        Returns observations (num_envs, features), rewards, terminated and truncated (num_envs,),
        and info, as in gymnasium.
        """
        if self._observations is None:
            raise ResetNeeded("call reset() before step()")
        actions = check_actions(self.action_space, actions)
        resting = (
            self._over & ~self._rest
            if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._over.any()
            else None
        )
        still = self._rest if self._rests else None
        if self.autoreset_mode is AutoresetMode.DISABLED and (self._over & ~self._rest).any():
            lanes = np.flatnonzero(self._over & ~self._rest).tolist()
            raise ResetNeeded(
                f'lanes {lanes[:8]} are over: call reset(options={{"reset_mask": mask}}) with '
                "these lanes before step()"
            )
        stays = still if resting is None else resting if still is None else still | resting
        rewards, terminated, truncated = self.task.step(actions, stays)
        if self.reward_space is not None:
            rewards = costs_as_rewards(self.task, stays)
        observations = self.task.observe(self._generators, stays)
        if still is not None:
            observations = np.where(still[:, None], self._observations, observations)
        info = self.task.info()
        over = terminated | truncated
        final: Info = {}
        again = resting
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        if same_step and over.any():
            last = np.full(self.num_envs, None, dtype=object)
            again = over
            for lane in np.flatnonzero(over).tolist():
                last[lane] = observations[lane].copy()
            final = {
                "final_obs": last,
                "_final_obs": over.copy(),
                "final_info": self._masked(info, over),
                "_final_info": over.copy(),
            }
        if again is not None:
            observations = np.where(
                again[:, None], self.task.reset(again, self._generators), observations
            )
            info = self.task.info()
        self._observations = observations
        if not same_step:
            self._over = over if still is None else over | (self._over & still)
        return observations.copy(), rewards, terminated, truncated, {**final, **self._masked(info)}

    def _masked(self, info: Info, which: NDArray[np.bool_] | None = None) -> Info:
        """Return info with a mask for each entry, in the form of gymnasium's vector environments.

        ``which`` (num_envs,) are the lanes to which info applies, None for all; entries of the
        others are zero.
        """
        masked = Info()
        mask = self._all.copy() if which is None else which.copy()
        others = None if which is None else ~which
        for name, values in info.items():
            if others is not None:
                values[others] = 0
            masked[name] = values
            masked["_" + name] = mask
        return masked

    def snapshot(self) -> dict[str, Any]:
        """Return everything on which the next steps depend, for `restore`.

        The snapshot consists of plain values and arrays and can be pickled.
        """
        if self._observations is None:
            raise ResetNeeded("call reset() before snapshot()")
        generators = [generator.bit_generator.state for generator in self._generators]
        parts = {"task": self.task.snapshot(), "generators": generators}
        return parts | {
            "seeds": list(self._seeds),
            "observations": self._observations.copy(),
            "over": self._over.copy(),
            "rest": self._rest.copy(),
        }

    def restore(self, snapshot: dict[str, Any]) -> Observation:
        """Continue bit for bit from the snapshot of an environment with the same arguments.

        Returns the observations (num_envs, features).
        """
        require(
            len(snapshot["seeds"]) == self.num_envs,
            "lanes of the snapshot",
            len(snapshot["seeds"]),
            f"num_envs = {self.num_envs}",
        )
        self._seed(snapshot["seeds"], np.ones(self.num_envs, dtype=np.bool_))
        for generator, state in zip(self._generators, snapshot["generators"], strict=True):
            generator.bit_generator.state = state
        self.task.restore(snapshot["task"])
        self._observations = snapshot["observations"].copy()
        self._over = snapshot["over"].copy()
        self._rest = snapshot.get("rest", np.zeros_like(self._over)).copy()
        self._rests = bool(self._rest.any())
        return self._observations.copy()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an image of each lane."""
        screen = make_screen(self, self._observations is not None, "make_vec")
        if screen is None:
            return None
        if self.render_mode == "human":
            screen.show(0)
            return None
        return tuple(screen.show(lane) for lane in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002 - gymnasium passes on what close() was given
        """Close the window and end the threads."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None
        self.task.close()


def environment(single: type[TaskEnv]) -> type[TaskEnv]:
    """Complete an environment's class: class decorator.

    It writes features and arguments into the class's docstring, and adds the native vector
    environment, with the corresponding name, to the class's module.
    """
    add_tables(single)
    name = single.__name__.replace("Env", "VectorEnv")
    text = (
        f"Native vector of `{single.__name__}`, see `TaskVectorEnv`; lane i is the single one "
        "with seed + i."
    )
    vector = type(
        name,
        (TaskVectorEnv,),
        {"__doc__": text, "__module__": single.__module__, "kind": single.kind},
    )
    setattr(sys.modules[single.__module__], name, vector)
    return single
