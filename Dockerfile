# The node on ROS 2 Jazzy, with kernels compiled for all processors of a level:
#   docker build -t unc_physics .
#   docker run --rm --network host --ipc host unc_physics
# On an ARM machine: docker build --build-arg PROCESSOR=generic -t unc_physics .
FROM ros:jazzy
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends build-essential cmake \
    python3-colcon-common-extensions python3-dev python3-tqdm python3-venv python3-yaml \
    && rm -rf /var/lib/apt/lists/*
ARG PROCESSOR=x86-64-v3
ENV NUMBA_CPU_NAME=${PROCESSOR} NUMBA_CPU_FEATURES="" NUMBA_DISABLE_INTEL_SVML=1
COPY . /workspace/src/unc_physics
WORKDIR /workspace
SHELL ["/bin/bash", "-c"]
# hadolint ignore=DL3013
RUN source /opt/ros/jazzy/setup.bash && python3 -m venv --system-site-packages venv && touch venv/COLCON_IGNORE \
    && source venv/bin/activate && pip install --no-cache-dir "numpy<2" "numba>=0.60,<0.69" scipy trimesh \
      coacd==1.0.14 manifold3d \
    && colcon build --base-paths src/unc_physics src/unc_physics/unc_physics_msgs \
    && source install/setup.bash && python -m unc_physics warm-up
CMD ["bash", "-c", "source /opt/ros/jazzy/setup.bash && source venv/bin/activate && source install/setup.bash \
    && exec ros2 run unc_physics unc_physics_node"]
