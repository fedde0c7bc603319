"""The motion that tells rival effects of a diagnosis apart, and how surely the next log will."""

from elid_cli.experiment.resolve.plan import Pair as Pair
from elid_cli.experiment.resolve.plan import Resolution as Resolution
from elid_cli.experiment.resolve.plan import ResolveOptions as ResolveOptions
from elid_cli.experiment.resolve.plan import resolve as resolve
from elid_cli.experiment.resolve.question import Question as Question
from elid_cli.experiment.resolve.question import question_of as question_of
from elid_cli.experiment.resolve.question import read_question as read_question
