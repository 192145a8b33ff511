"""What `kfgen` gives: the types of the lazy table in ``__init__.py``."""

from kfgen.calibrate.calibrate import calibrate as calibrate
from kfgen.catalogue import list_all as list_all
from kfgen.consumers import convert as convert
from kfgen.effects.noise_model import NoiseModel as NoiseModel
from kfgen.emit.emit import emit as emit
from kfgen.fleet.fleet import fleet as fleet  # type: ignore[attr-defined,import-not-found,import-untyped,unused-ignore]
from kfgen.gap.find_gap import find_gap as find_gap  # type: ignore[import-not-found,import-untyped,unused-ignore]
from kfgen.gap.flight.noise.tune import tune as tune
from kfgen.gap.judge.judge import judge as judge
from kfgen.gap.plan_between import plan_between as plan_between
from kfgen.identify.identify_log import identify as identify  # type: ignore[import-not-found,import-untyped,unused-ignore]
from kfgen.identify.plan import plan as plan
from kfgen.log.contents import contents as contents
from kfgen.log.log import Channel as Channel
from kfgen.log.log import Log as Log
from kfgen.log.readers import read_log as read_log
from kfgen.log.readers import write_log as write_log
from kfgen.model.build import build as build
from kfgen.model.derive import derive as derive
from kfgen.model.files import load as load
from kfgen.model.files import save as save
from kfgen.run.adaptive.denoise_log import denoise as denoise
from kfgen.run.audit import audit as audit
from kfgen.run.run import run as run
from kfgen.simulate.simulate_log import simulate as simulate
from kfgen.verify.compare import verify as verify

__version__: str
VERBS: dict[str, str]
TYPES: dict[str, str]
