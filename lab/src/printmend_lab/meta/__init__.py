"""A learner that was taught to learn: a network, trained offline on simulated machines, says what to believe of one."""

from printmend_lab.meta.meta import LEARNERS, MetaLearner, MetaModel

__all__ = ["LEARNERS", "MetaLearner", "MetaModel"]
