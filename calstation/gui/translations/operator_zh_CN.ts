<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>BadgeField</name>
    <message>
        <source>Sign out</source>
        <translation>退出登录</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>name or badge</source>
        <translation>姓名或工号</translation>
    </message>
    <message>
        <source>scan your badge</source>
        <translation>扫描工牌</translation>
    </message>
</context>
<context>
    <name>CertificateButton</name>
    <message>
        <source>No certificate was issued</source>
        <translation>未能签发证书</translation>
    </message>
    <message>
        <source>Certificate</source>
        <translation>证书</translation>
    </message>
    <message>
        <source>Certificate, {0:.0f} %</source>
        <translation>证书，{0:.0f} %</translation>
    </message>
    <message>
        <source>Issue a certificate?</source>
        <translation>签发证书？</translation>
    </message>
    <message>
        <source>Certificate {0} was issued on {1}</source>
        <translation>证书 {0} 已于 {1} 签发</translation>
    </message>
    <message>
        <source>Its result, its templates or the program have changed since.</source>
        <translation>此后其结果、模板或程序已有变动。</translation>
    </message>
    <message>
        <source>Issue a revision…</source>
        <translation>签发修订版…</translation>
    </message>
    <message>
        <source>Why is certificate {0} revised?</source>
        <translation>为何修订证书 {0}？</translation>
    </message>
    <message>
        <source>The certificate was issued</source>
        <translation>证书已签发</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Open</source>
        <translation>打开</translation>
    </message>
</context>
<context>
    <name>ClaimNotice</name>
    <message>
        <source>Agree which station goes on with it.</source>
        <translation>请商定由哪个工位继续。</translation>
    </message>
</context>
<context>
    <name>Convergence</name>
    <message>
        <source>Sigma as a multiple of its target</source>
        <translation>标准差与目标值之比</translation>
    </message>
    <message>
        <source>device time, min</source>
        <translation>设备时间，min</translation>
    </message>
    <message>
        <source>target</source>
        <translation>目标</translation>
    </message>
    <message>
        <source>{value} reached</source>
        <translation>{value} 已达标</translation>
    </message>
</context>
<context>
    <name>FiguresTable</name>
    <message>
        <source>nearest to its limit</source>
        <translation>最接近限差的</translation>
    </message>
    <message>
        <source>value</source>
        <translation>值</translation>
    </message>
    <message>
        <source>sigma</source>
        <translation>标准差</translation>
    </message>
    <message>
        <source>limit</source>
        <translation>限差</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>outside its limit</source>
        <translation>超出限差</translation>
    </message>
</context>
<context>
    <name>InterruptedRuns</name>
    <message>
        <source>The run was not closed</source>
        <translation>这次标定未能结束</translation>
    </message>
    <message>
        <source>Earlier runs were not closed or handed over</source>
        <translation>以前的标定未能结束或上交</translation>
    </message>
</context>
<context>
    <name>LabelButton</name>
    <message>
        <source>The label was not printed</source>
        <translation>标签未打印</translation>
    </message>
    <message>
        <source>Print label</source>
        <translation>打印标签</translation>
    </message>
    <message>
        <source>The label was sent to the printer</source>
        <translation>标签已发送到打印机</translation>
    </message>
    <message>
        <source>The label was saved as a PDF file</source>
        <translation>标签已存为 PDF 文件</translation>
    </message>
</context>
<context>
    <name>Loading</name>
    <message>
        <source>Load the unit</source>
        <translation>装上产品</translation>
    </message>
</context>
<context>
    <name>OperatorPage</name>
    <message>
        <source>{count} units</source>
        <translation>{count} 台产品</translation>
    </message>
</context>
<context>
    <name>PositionPanel</name>
    <message>
        <source>Enough positions: finish</source>
        <translation>位置已够，结束采集</translation>
    </message>
</context>
<context>
    <name>PositionPicture</name>
    <message>
        <source>down</source>
        <translation>下</translation>
    </message>
</context>
<context>
    <name>Preparation</name>
    <message>
        <source>Preparing</source>
        <translation>准备</translation>
    </message>
</context>
<context>
    <name>RunHeader</name>
    <message>
        <source>Press Space or click; Enter does not start, scanners send it.</source>
        <translation>请按空格键或点击；回车不会启动，因为扫码枪会发送回车。</translation>
    </message>
    <message>
        <source>Resume</source>
        <translation>继续</translation>
    </message>
    <message>
        <source>Pause</source>
        <translation>暂停</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>scan or type</source>
        <translation>扫描或输入</translation>
    </message>
    <message>
        <source>START</source>
        <translation>开始全参数标定</translation>
    </message>
    <message>
        <source>START PARTIAL</source>
        <translation>开始部分标定</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
</context>
<context>
    <name>RunStarter</name>
    <message>
        <source>twice</source>
        <translation>重复</translation>
    </message>
    <message>
        <source>no slot left</source>
        <translation>没有空装夹位</translation>
    </message>
    <message>
        <source>attempt {count}</source>
        <translation>第 {count} 次</translation>
    </message>
    <message>
        <source>accepted</source>
        <translation>已接受</translation>
    </message>
    <message>
        <source>Calibrate {0} nevertheless?</source>
        <translation>仍然标定 {0}？</translation>
    </message>
    <message>
        <source>next unit</source>
        <translation>下一个产品</translation>
    </message>
    <message>
        <source>all slots have a unit</source>
        <translation>所有装夹位都有产品</translation>
    </message>
    <message>
        <source>the other slots stay empty</source>
        <translation>其余装夹位空着</translation>
    </message>
    <message>
        <source>slot {slot}</source>
        <translation>装夹位 {slot}</translation>
    </message>
    <message>
        <source>not valid</source>
        <translation>无效</translation>
    </message>
</context>
<context>
    <name>ShiftCounter</name>
    <message>
        <source>Since {time}</source>
        <translation>自 {time} 起</translation>
    </message>
    <message>
        <source>{count} done</source>
        <translation>完成 {count}</translation>
    </message>
    <message>
        <source>{count} passed</source>
        <translation>合格 {count}</translation>
    </message>
    <message>
        <source>{count} failed</source>
        <translation>不合格 {count}</translation>
    </message>
    <message>
        <source>yield {percent} %</source>
        <translation>合格率 {percent} %</translation>
    </message>
    <message>
        <source>{time} per unit</source>
        <translation>平均每台 {time}</translation>
    </message>
</context>
<context>
    <name>SlotsPanel</name>
    <message>
        <source>{count} of {slots} slots have a unit</source>
        <translation>{slots} 个装夹位中 {count} 个有产品</translation>
    </message>
</context>
<context>
    <name>StageList</name>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>not run</source>
        <translation>未做</translation>
    </message>
    <message>
        <source>{time} in all</source>
        <translation>共 {time}</translation>
    </message>
    <message>
        <source>{time} left</source>
        <translation>剩余 {time}</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>Partial calibration, without {stages}</source>
        <translation>部分标定，不做{stages}</translation>
    </message>
    <message>
        <source>Times of a real table; the virtual bench is much faster.</source>
        <translation>这是真实转台的时间，虚拟台架快得多。</translation>
    </message>
</context>
<context>
    <name>TablePanel</name>
    <message>
        <source>outer</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>table not connected</source>
        <translation>转台未连接</translation>
    </message>
    <message>
        <source>gimbal not connected</source>
        <translation>框架未连接</translation>
    </message>
    <message>
        <source>table moving</source>
        <translation>转台转动</translation>
    </message>
    <message>
        <source>gimbal turning</source>
        <translation>框架转动</translation>
    </message>
    <message>
        <source>table at rest</source>
        <translation>转台静止</translation>
    </message>
    <message>
        <source>gimbal at rest</source>
        <translation>框架静止</translation>
    </message>
</context>
<context>
    <name>Traces</name>
    <message>
        <source>Gyro, °/s</source>
        <translation>陀螺，°/s</translation>
    </message>
    <message>
        <source>Accelerometer, m/s²</source>
        <translation>加表，m/s²</translation>
    </message>
    <message>
        <source>Holds the plot; the run and its recording go on.</source>
        <translation>画面定格，标定和记录照常进行。</translation>
    </message>
    <message>
        <source>10 s</source>
        <translation>10 秒</translation>
    </message>
    <message>
        <source>1 min</source>
        <translation>1 分钟</translation>
    </message>
    <message>
        <source>10 min</source>
        <translation>10 分钟</translation>
    </message>
    <message>
        <source>Hold</source>
        <translation>定格</translation>
    </message>
    <message>
        <source>device time before now, s</source>
        <translation>距现在的设备时间，s</translation>
    </message>
</context>
<context>
    <name>UnitTiles</name>
    <message>
        <source>outside limits, registers kept</source>
        <translation>超差，保留原有寄存器</translation>
    </message>
    <message>
        <source>σ {share} × its target</source>
        <translation>σ 为目标的 {share} 倍</translation>
    </message>
    <message>
        <source>{sigma}, reached</source>
        <translation>{sigma}，已达到</translation>
    </message>
    <message>
        <source>preparing</source>
        <translation>准备中</translation>
    </message>
</context>
<context>
    <name>VerdictPanel</name>
    <message>
        <source>Understood</source>
        <translation>知道了</translation>
    </message>
    <message>
        <source>Details</source>
        <translation>详情</translation>
    </message>
    <message>
        <source>All units</source>
        <translation>全部产品</translation>
    </message>
    <message>
        <source>Open the station page</source>
        <translation>打开工位页</translation>
    </message>
    <message>
        <source>{count} units</source>
        <translation>{count} 台产品</translation>
    </message>
    <message>
        <source>Where: {place}</source>
        <translation>位置：{place}</translation>
    </message>
    <message>
        <source>attempt {count}</source>
        <translation>第 {count} 次</translation>
    </message>
    <message>
        <source>{time} of table time</source>
        <translation>转台时间 {time}</translation>
    </message>
    <message>
        <source>registers written and read back, effect not verified</source>
        <translation>寄存器已写入并回读一致，效果未能核对</translation>
    </message>
    <message>
        <source>registers written and verified</source>
        <translation>寄存器已写入并核对</translation>
    </message>
</context>
<context>
    <name>_SlotTile</name>
    <message>
        <source>attempt {count}</source>
        <translation>第 {count} 次</translation>
    </message>
    <message>
        <source>accepted</source>
        <translation>已接受</translation>
    </message>
    <message>
        <source>suggested</source>
        <translation>建议值</translation>
    </message>
    <message>
        <source>stays empty</source>
        <translation>留空</translation>
    </message>
    <message>
        <source>next scan</source>
        <translation>下一次扫描</translation>
    </message>
    <message>
        <source>empty</source>
        <translation>空</translation>
    </message>
    <message>
        <source>Skip</source>
        <translation>跳过</translation>
    </message>
    <message>
        <source>Use</source>
        <translation>启用</translation>
    </message>
    <message>
        <source>Clear</source>
        <translation>清除</translation>
    </message>
</context>
</TS>
