"""A Ray cluster of two nodes of one core each on this machine, until a line comes in."""

from __future__ import annotations

import sys
from typing import Any

from ray.cluster_utils import Cluster

NODE: dict[str, Any] = {"num_cpus": 1, "num_gpus": 0, "object_store_memory": 80 * 2**20}

if __name__ == "__main__":
    nodes: Any = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
    nodes.add_node(**NODE)
    print(nodes.address, flush=True)
    sys.stdin.readline()
    nodes.shutdown()
