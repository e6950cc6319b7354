// SPDX-License-Identifier: Apache-2.0
// The peer that everybody knows: gRPC's own C++ library in its best form for this, asynchronous on one
// completion queue and one thread, frames of 1 MiB, no bandwidth probes, a wide look-ahead.
//
//     peer_grpcpp ASSET        prints its port
#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "peer_work.h"
#include "umbrage/v1/shadows.grpc.pb.h"

namespace {

using umbrage::v1::QueryReply;
using umbrage::v1::QueryRequest;
using umbrage::v1::Shadows;

class Call {
public:
    Call(Shadows::AsyncService *service, grpc::ServerCompletionQueue *queue, const umb_asset *asset)
        : service_(service), queue_(queue), asset_(asset), responder_(&context_)
    {
        service_->RequestQuery(&context_, &request_, &responder_, queue_, queue_, this);
    }

    void Proceed(bool ok)
    {
        if (!ok || answered_) {
            delete this;
            return;
        }
        new Call(service_, queue_, asset_);
        answered_ = true;
        const std::string &points = request_.points();
        std::string *values = reply_.mutable_visibility();
        values->resize(points.size() / 12);
        reply_.set_asset_id(std::string(32, '\0'));
        if (!peer_answer(asset_, points.data(), values->size(),
                         reinterpret_cast<uint8_t *>(&(*values)[0]))) {
            responder_.FinishWithError(grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, "points"), this);
            return;
        }
        responder_.Finish(reply_, grpc::Status::OK, this);
    }

private:
    Shadows::AsyncService *service_;
    grpc::ServerCompletionQueue *queue_;
    const umb_asset *asset_;
    grpc::ServerContext context_;
    QueryRequest request_;
    QueryReply reply_;
    grpc::ServerAsyncResponseWriter<QueryReply> responder_;
    bool answered_ = false;
};

}  // namespace

int main(int argc, char **argv)
{
    if (argc != 2) {
        return 2;
    }
    const umb_asset *asset = peer_asset(argv[1]);
    int port = 0;
    Shadows::AsyncService service;
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&service);
    builder.SetMaxReceiveMessageSize(64 << 20);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, 1 << 20);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 32 << 20);
    std::unique_ptr<grpc::ServerCompletionQueue> queue = builder.AddCompletionQueue();
    std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
    if (!server) {
        return 1;
    }
    for (int i = 0; i < 64; i++) {
        new Call(&service, queue.get(), asset);
    }
    peer_say_port(port);
    void *tag;
    bool ok;
    while (queue->Next(&tag, &ok)) {
        static_cast<Call *>(tag)->Proceed(ok);
    }
    return 0;
}
